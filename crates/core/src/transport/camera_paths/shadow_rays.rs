//! Shadow rays of connections with light sources, and what they add to their paths.

use super::{CameraPass, CameraPaths};
use crate::accel::Coherence;
use crate::base::math::Rgb;
use crate::scene::MediumState;
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::{LANES, Mask, Vec3s};
use crate::transport::path_queue::Columns;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Sixteen shadow rays with the contributions of the connections that they test.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Connections {
    /// Points on light sources.
    pub origin: Vec3s,
    /// Vectors to the vertices.
    pub direction: Vec3s,
    /// Paths with the media around their vertices, and [`Connections::CAUSTIC`] or
    /// [`Connections::METER`].
    pub path: [u32; LANES],
    pub contribution: Vec3s,
}

impl Connections {
    /// Marks connections from rough lobes after the first diffuse vertex: they are part of
    /// caustics, and of no suffix that begins at their vertex.
    pub const CAUSTIC: u32 = 1 << 31;
    /// Marks connections from meters.
    pub const METER: u32 = 1 << 30;
    /// Start of the media. Below it there is room for 2^24 paths; batches have less than 2^17.
    const MEDIA_AT: u32 = 24;
    const PATH: u32 = (1 << Self::MEDIA_AT) - 1;

    /// The path of a vertex in these media.
    #[inline(always)] // part of a vector loop
    pub fn path_in(path: u32, media: MediumState) -> u32 {
        path | u32::from(media.0) << Self::MEDIA_AT
    }

    /// The media of [`Self::path_in`].
    fn media(path: u32) -> MediumState {
        MediumState((path >> Self::MEDIA_AT) as u8 & (MediumState::COUNT as u8 - 1))
    }
}

impl Columns<10> for Connections {
    /// Shadow rays end a few rounding errors before the vertices. They may start far outside of the
    /// scene, where coordinates have larger rounding errors than at the vertices: rays that end at
    /// a vertex may meet its surface.
    const T_FAR: f32 = 1.0 - 32.0 * f32::EPSILON;
}

impl CameraPaths {
    /// Queues shadow rays of the `active` lanes between start points of vertices and points on
    /// light sources; `contribution` is added to the paths of the rays that nothing blocks.
    #[inline(always)] // vectorized
    pub(super) fn queue_shadow_rays(
        &mut self,
        simd: Simd,
        active: &Mask,
        [off_surface, target]: [&Vec3s; 2],
        path: &[u32; LANES],
        contribution: &Vec3s,
    ) {
        let (mut sent, mut direction) = (*active, Vec3s::default());
        for (lane, sent) in sent.iter_mut().enumerate() {
            *sent &= contribution.get(lane) != Rgb::ZERO;
            direction.set(lane, off_surface.get(lane) - target.get(lane));
        }
        // From the light source, so that shadow rays to one point of it share their origin.
        let (origin, path, contribution) = (*target, *path, *contribution);
        self.shadow_rays.append(
            simd,
            &sent,
            &Connections { origin, direction, path, contribution },
        );
    }

    /// Adds the contributions of all connections that nothing blocks.
    pub(super) fn add_connections(&mut self, pass: &CameraPass, coherence: Coherence) {
        let (accel, media) = (pass.accel, pass.scene.media());
        let count = self.shadow_rays.len();
        let rays = vectorized(
            #[inline(always)]
            |_| self.shadow_rays.rays(),
        );
        self.rays += count as u64;
        self.occluded.resize(rays.len(), Mask::default());
        accel.occlude(rays, count, &mut self.occluded, coherence);
        let mut connections = Connections::default();
        for (packet, occluded) in self.occluded.iter().enumerate() {
            let count = self.shadow_rays.load(packet, &mut connections);
            for (lane, occluded) in occluded.iter().enumerate().take(count) {
                // Adds 0 in the shadow: a branch could not be predicted.
                let contribution = connections.contribution.get(lane);
                let mut visible = if *occluded { Rgb::ZERO } else { contribution };
                let path = connections.path[lane];
                if let Some(media) = media
                    && visible != Rgb::ZERO
                {
                    let target = connections.origin.get(lane);
                    let segment = [target + connections.direction.get(lane), target];
                    let media_at = Connections::media(path);
                    visible *= media.transmittance(pass.scene, accel, media_at, segment);
                }
                let index = (path & Connections::PATH) as usize;
                self.direct[index] += visible;
                if path & Connections::CAUSTIC != 0
                    && let Some(recorder) = &mut self.suffixes
                {
                    recorder.add_other(index, visible);
                }
                if self.records_aovs {
                    let aov = &mut self.aovs[index];
                    match path & Connections::METER {
                        0 => aov.add_connection(visible, path & Connections::CAUSTIC != 0),
                        _ => aov.emission += visible,
                    }
                }
            }
        }
        self.shadow_rays.clear();
        self.add_pane_light();
    }

    /// Queues one shadow ray as [`Self::queue_shadow_rays`] does.
    pub(super) fn queue_shadow_ray(
        &mut self,
        path: u32,
        contribution: Rgb,
        target: Vec3,
        off_surface: Vec3,
    ) {
        if contribution == Rgb::ZERO {
            return;
        }
        self.shadow_rays.push(&Connections {
            origin: Vec3s::splat(target),
            direction: Vec3s::splat(off_surface - target),
            path: [path; LANES],
            contribution: Vec3s::splat(contribution),
        });
    }
}
