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
    /// Points on light sources, or the vertices of [`Connections::FROM_VERTEX`].
    pub origin: Vec3s,
    /// Vectors to the vertices, or from them.
    pub direction: Vec3s,
    /// Paths with the media around their vertices, and [`Connections::CAUSTIC`],
    /// [`Connections::METER`] or [`Connections::FROM_VERTEX`].
    pub path: [u32; LANES],
    pub contribution: Vec3s,
}

impl Connections {
    /// Marks connections from rough lobes after the first diffuse vertex: they are part of
    /// caustics, and of no suffix that begins at their vertex.
    pub const CAUSTIC: u32 = 1 << 31;
    /// Marks connections from meters.
    pub const METER: u32 = 1 << 30;
    /// Start of the media.
    const MEDIA_AT: u32 = 24;
    /// Marks shadow rays from vertices to light sources. Below it there is room for 2^23 paths;
    /// batches have less than 2^17.
    const FROM_VERTEX: u32 = 1 << 23;
    const PATH: u32 = Self::FROM_VERTEX - 1;
    /// Distance of light sources from the origin over that of vertices, from which on shadow rays
    /// start at the vertices. Rays end where the rounding errors of their start let them. At this
    /// factor they are 6e-5 of the coordinates of the vertex.
    const FAR: f32 = 16.0;

    /// The path of a vertex in these media.
    #[inline(always)] // part of a vector loop
    pub fn path_in(path: u32, media: MediumState) -> u32 {
        path | u32::from(media.0) << Self::MEDIA_AT
    }

    /// Sets the ray of a lane between a light source and a vertex. From the light source, shadow
    /// rays to one point of it share their origin. To a light source that is far away, they start
    /// at the vertex: single precision rounds the end of a ray as its start.
    #[inline(always)] // part of a vector loop
    fn set_ray(&mut self, lane: usize, target: Vec3, vertex: Vec3) {
        let is_far = target.length_squared() > Self::FAR * Self::FAR * vertex.length_squared();
        let to_vertex = vertex - target;
        self.origin.set(lane, if is_far { vertex } else { target });
        self.direction.set(lane, to_vertex * if is_far { -1.0 } else { 1.0 });
        self.path[lane] |= if is_far { Self::FROM_VERTEX } else { 0 };
    }

    /// The media of [`Self::path_in`].
    fn media(path: u32) -> MediumState {
        MediumState((path >> Self::MEDIA_AT) as u8 & (MediumState::COUNT as u8 - 1))
    }
}

impl Columns<10> for Connections {
    /// Shadow rays end a few rounding errors before their end points: rays that end at a vertex may
    /// meet its surface.
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
        let (mut sent, contribution) = (*active, *contribution);
        let mut connections = Connections { path: *path, contribution, ..Connections::default() };
        for (lane, sent) in sent.iter_mut().enumerate() {
            *sent &= contribution.get(lane) != Rgb::ZERO;
            connections.set_ray(lane, target.get(lane), off_surface.get(lane));
        }
        self.shadow_rays.append(simd, &sent, &connections);
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
                    let origin = connections.origin.get(lane);
                    let end = origin + connections.direction.get(lane);
                    let segment = match path & Connections::FROM_VERTEX {
                        0 => [end, origin],
                        _ => [origin, end],
                    };
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
        let mut connections = Connections {
            path: [path; LANES],
            contribution: Vec3s::splat(contribution),
            ..Connections::default()
        };
        connections.set_ray(0, target, off_surface);
        self.shadow_rays.push(&connections);
    }
}
