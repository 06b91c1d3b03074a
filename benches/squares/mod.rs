//! Camera paths as a render merges them together.

use super::paired::timed;
use bdpm::accel::Intersect;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::{Scene, Settings};
use std::sync::Arc;
use std::time::Duration;

/// Camera paths that are merged, about.
const LOOK_UPS: u32 = 131_072;

/// Squares of an image, in which a render merges the camera paths together.
pub struct Squares<'a> {
    pass: CameraPass<'a>,
    /// Their first column and row.
    corners: Vec<[u32; 2]>,
    /// Pixels along each edge.
    side: u32,
}

impl<'a> Squares<'a> {
    /// Chooses squares of about `together` camera paths from all over the image, enough for
    /// [`LOOK_UPS`].
    pub fn new(
        scene: &'a Arc<Scene>,
        accel: &'a Arc<dyn Intersect>,
        settings: &'a Settings,
        together: usize,
    ) -> Self {
        let Settings { width, height, camera_paths, .. } = *settings;
        let key = StreamKey::new(1, Stream::CameraPath, 0);
        let view = scene.camera.view(width, height);
        let pass = CameraPass {
            scene,
            view,
            accel: &**accel,
            settings,
            key,
            gather_early: false,
            hides_lights: false,
            points: None,
            cache: None,
            light_edges: None,
        };
        let side = (together as u32 / camera_paths).isqrt();
        let (columns, rows) = (width / side, height / side);
        let count = LOOK_UPS.div_ceil(side * side * camera_paths).min(columns * rows);
        // By the golden section: neither one column nor one row after the other.
        let at = |index: u32| (f64::from(index) * 0.618_034).fract();
        let place = |index| (at(index) * f64::from(columns * rows)) as u32;
        let corner = |index| [place(index) % columns * side, place(index) / columns * side];
        let corners = (1..=count).map(corner).collect();
        Self { pass, corners, side }
    }

    /// Traces the camera paths of one square after the other.
    pub fn each(&self, mut visit: impl FnMut(&CameraPaths)) {
        let mut paths = CameraPaths::default();
        for &[x0, y0] in &self.corners {
            let pixels = (0..self.side).flat_map(|y| (0..self.side).map(move |x| [x0 + x, y0 + y]));
            let all = 0..self.pass.settings.camera_paths;
            let ids = pixels
                .flat_map(|[x, y]| all.clone().map(move |index| CameraPathId { x, y, index }));
            let mut ids = ids.peekable();
            paths.clear();
            while ids.peek().is_some() {
                paths.trace(&self.pass, ids.by_ref().take(CameraPaths::BATCH));
            }
            visit(&paths);
        }
    }

    /// Time of `work` with all squares, as they lie in the caches after they are traced.
    pub fn time(&self, mut work: impl FnMut(&CameraPaths)) -> Duration {
        let mut time = Duration::ZERO;
        self.each(|paths| time += timed(|| work(paths)));
        time
    }
}
