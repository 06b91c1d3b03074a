//! Tests when a device is made that the loaded library writes hits to the addresses of the header.
//!
//! The version is not enough: hits have one size before 4.3.0 and another from then on, and build
//! options of the library (instance arrays, levels of instances) change it within one version.

use super::packets::{self, PacketSize};
use super::{CommittedScene, Device, EmbreeError, single};
use crate::{Hit, Ray, TriangleMesh};
use glam::{DAffine3, DVec3, Vec3};

/// Number of words behind a query: enough for 32 more levels of instances in packets of 16.
const GUARD: usize = 1024;

/// Pattern that is no identifier, index or number of the traced scene.
const UNTOUCHED: u32 = 0xdead_beef;

/// A query that the library writes to, and behind it words that it must not change.
#[repr(C)]
pub(super) struct Guarded<T> {
    query: T,
    guard: [u32; GUARD],
}

impl<T: Copy> Guarded<T> {
    pub(super) fn new(query: T) -> Self {
        Self { query, guard: [UNTOUCHED; GUARD] }
    }

    /// Pointer to the query that is also valid for the guard.
    pub(super) fn as_mut_ptr(&mut self) -> *mut T {
        (&raw mut *self).cast()
    }

    /// The query, if its guard is unchanged.
    pub(super) fn get(&self) -> Option<T> {
        (self.guard == [UNTOUCHED; GUARD]).then_some(self.query)
    }
}

/// Traces a ray alone and in a packet as wide as `device` uses, to an instance, whose hit sets all
/// fields.
///
/// # Errors
/// [`EmbreeError::Layout`] if the result is not that hit, or the guard changes.
pub(super) fn check(device: &Device) -> Result<(), EmbreeError> {
    let scene = scene(device)?;
    let hits = traced(&scene, PacketSize::of(device));
    let is_right = |hit: Hit| {
        let close = [(hit.t, 2.0), (hit.u, 0.25), (hit.v, 0.5)];
        (hit.mesh, hit.triangle) == (2, 1) && close.iter().all(|(a, b)| (a - b).abs() < 1e-3)
    };
    if hits.into_iter().all(|hit| hit.is_some_and(is_right)) {
        return Ok(());
    }
    Err(EmbreeError::Layout { library: device.version() })
}

/// The hits of a ray alone and in a packet; `None` if the library wrote behind them.
fn traced(scene: &CommittedScene, size: PacketSize) -> [Option<Hit>; 2] {
    let ray = Ray::new(Vec3::new(10.25, 0.5, 2.0), Vec3::NEG_Z);
    // SAFETY: the scene is committed and lives until the end of this function.
    unsafe { [single::guarded(scene.handle(), &ray), packets::guarded(scene.handle(), size, &ray)] }
}

/// A scene with an instance, at x = 10, of a mesh whose second triangle the ray hits. All numbers
/// differ: the instance is 1 and the mesh in it 1, so the hit is on mesh 2 of the scene.
fn scene(device: &Device) -> Result<CommittedScene, EmbreeError> {
    let nothing = TriangleMesh { positions: &[], triangles: &[] };
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NEG_X];
    let mesh = TriangleMesh { positions: &positions, triangles: &[[0, 2, 3], [0, 1, 2]] };
    let mut builder = device.scene_builder()?;
    builder.add_mesh(nothing)?;
    let shared = builder.share(&[nothing, mesh])?;
    builder.place(shared, DAffine3::from_translation(DVec3::X * 10.0))?;
    builder.commit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use embree4_sys as sys;

    #[test]
    fn what_is_written_behind_a_query_is_noticed() {
        let mut guarded = Guarded::new(sys::RTCRayHit16::default());
        assert!(guarded.get().is_some());
        for word in [0, 64, GUARD - 1] {
            let behind = guarded.as_mut_ptr().wrapping_add(1).cast::<u32>().wrapping_add(word);
            // SAFETY: within `guarded`, whose pointer this is and which nothing else refers to.
            unsafe { behind.write(0) };
            assert!(guarded.get().is_none(), "{word}");
            // SAFETY: as above.
            unsafe { behind.write(UNTOUCHED) };
            assert!(guarded.get().is_some(), "{word}");
        }
    }

    /// Every width that this processor has is tried, and the guard begins right behind each struct.
    #[test]
    fn the_library_at_hand_writes_where_its_header_says() {
        let device = Device::new().unwrap();
        let scene = scene(&device).unwrap();
        for size in [PacketSize::Four, PacketSize::Eight, PacketSize::Sixteen] {
            let names = traced(&scene, size).map(|hit| hit.map(|hit| (hit.mesh, hit.triangle)));
            assert_eq!(names, [Some((2, 1)); 2], "{size:?}");
        }
        assert_eq!(
            std::mem::offset_of!(Guarded<sys::RTCRayHit>, guard),
            size_of::<sys::RTCRayHit>()
        );
        assert_eq!(
            std::mem::offset_of!(Guarded<sys::RTCRayHit16>, guard),
            size_of::<sys::RTCRayHit16>()
        );
    }
}
