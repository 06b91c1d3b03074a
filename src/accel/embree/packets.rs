//! Ray queries: the renderer's hot path. No allocation and no error polling. Batches are transposed
//! between our order (one ray after the other) and Embree's (all x of the origins, all y, ...).
//!
//! Packets serve unrelated rays as well: with AVX-512 and 36 to 217,000 triangles, packets of 16 are
//! 5.7 to 7.8 times as fast as single rays on coherent rays and 1.1 to 1.5 times on incoherent ones.
//! Over packets that are ready in memory, transposing costs up to 28 % on coherent rays, which take
//! but 9 to 20 ns each, and up to 7 % on incoherent ones (`cargo bench --bench trace`).

use super::Device;
use crate::accel::{Coherence, Hit, Ray};
use embree4_sys as sys;
use glam::{Mat4, Vec4};
use std::ptr::null_mut;

/// Rays per packet; decided once per device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PacketSize {
    Four,
    Eight,
    Sixteen,
}

impl PacketSize {
    /// The widest packet that `device` traces as one.
    pub(super) fn of(device: &Device) -> Self {
        match device.native_packet_size() {
            16 => Self::Sixteen,
            8 => Self::Eight,
            _ => Self::Four, // Embree splits what it does not trace as one
        }
    }

    pub(super) const fn rays(self) -> usize {
        match self {
            Self::Four => 4,
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }
}

/// What every ray has in common, whatever its width: visible to all masks, at time 0, no flags.
macro_rules! fresh_ray {
    ($ray:ident, $mask:expr) => {
        sys::$ray { mask: $mask, ..Default::default() }
    };
}

fn single_ray(ray: &Ray) -> sys::RTCRay {
    sys::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        tnear: ray.t_near,
        dir_x: ray.direction.x,
        dir_y: ray.direction.y,
        dir_z: ray.direction.z,
        tfar: ray.t_far,
        ..fresh_ray!(RTCRay, !0)
    }
}

/// # Safety
/// `scene` must be committed, and stay alive and unchanged during the call.
pub(super) unsafe fn closest_hit(scene: sys::RTCScene, ray: &Ray) -> Hit {
    let mut query = sys::RTCRayHit { ray: single_ray(ray), ..Default::default() };
    query.hit.geomID = sys::RTC_INVALID_ID;
    query.hit.instID[0] = sys::RTC_INVALID_ID;
    // SAFETY: the scene is as the caller promised. `query` is an aligned local of the type that
    // the linked library's header describes. Null arguments mean Embree's defaults.
    unsafe { sys::rtcIntersect1(scene, &mut query, null_mut()) };
    if query.hit.geomID == sys::RTC_INVALID_ID {
        return Hit::MISS;
    }
    Hit {
        t: query.ray.tfar,
        u: query.hit.u,
        v: query.hit.v,
        mesh: named(query.hit.instID[0], query.hit.geomID),
        triangle: query.hit.primID,
    }
}

/// The mesh of a hit: instances are named as the first of the meshes that they show.
#[inline(always)]
fn named(instance: u32, geometry: u32) -> u32 {
    if instance == sys::RTC_INVALID_ID { geometry } else { instance + geometry }
}

/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn is_occluded(scene: sys::RTCScene, ray: &Ray) -> bool {
    let mut query = single_ray(ray);
    // SAFETY: as in `closest_hit`.
    unsafe { sys::rtcOccluded1(scene, &mut query, null_mut()) };
    is_hit(query.tfar)
}

/// Embree marks an occluded ray by the far end minus infinity.
fn is_hit(t_far: f32) -> bool {
    t_far == f32::NEG_INFINITY
}

/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn closest_hits(
    scene: sys::RTCScene,
    size: PacketSize,
    rays: &[Ray],
    hits: &mut [Hit],
    coherence: Coherence,
) {
    // SAFETY: the caller's promise about the scene is handed on.
    unsafe {
        match size {
            PacketSize::Sixteen => packet16::closest_hits(scene, rays, hits, coherence),
            PacketSize::Eight => packet8::closest_hits(scene, rays, hits, coherence),
            PacketSize::Four => packet4::closest_hits(scene, rays, hits, coherence),
        }
    }
}

/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn occlusions(
    scene: sys::RTCScene,
    size: PacketSize,
    rays: &[Ray],
    occluded: &mut [bool],
    coherence: Coherence,
) {
    // SAFETY: the caller's promise about the scene is handed on.
    unsafe {
        match size {
            PacketSize::Sixteen => packet16::occlusions(scene, rays, occluded, coherence),
            PacketSize::Eight => packet8::occlusions(scene, rays, occluded, coherence),
            PacketSize::Four => packet4::occlusions(scene, rays, occluded, coherence),
        }
    }
}

/// The remainder of a batch is traced one by one up to this length, else as a masked packet.
const MAX_SINGLES: usize = 2;

fn query_flags(coherence: Coherence) -> sys::RTCRayQueryFlags {
    match coherence {
        Coherence::Coherent => sys::RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT,
        Coherence::Incoherent => sys::RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_INCOHERENT,
    }
}

/// Four rays' (origin, t_near) or (direction, t_far) as four vectors of one component each.
#[inline(always)]
fn transposed(rows: [Vec4; 4]) -> [Vec4; 4] {
    let [a, b, c, d] = rows;
    let columns = Mat4::from_cols(a, b, c, d).transpose();
    [columns.x_axis, columns.y_axis, columns.z_axis, columns.w_axis]
}

macro_rules! packets {
    ($name:ident, $n:literal, $ray:ident, $ray_hit:ident, $intersect:ident, $occluded:ident) => {
        mod $name {
            use super::*;

            /// One lane is traced if its entry is -1. Embree wants this as aligned as the packet.
            #[repr(C, align(64))]
            struct Valid([i32; $n]);

            impl Valid {
                fn first(count: usize) -> Self {
                    Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
                }
            }

            #[inline(always)]
            fn stage(rays: &[Ray; $n], packet: &mut sys::$ray) {
                for first in (0..$n).step_by(4) {
                    let four: &[Ray; 4] = rays[first..first + 4].try_into().unwrap();
                    let [x, y, z, t] = transposed(four.map(|ray| ray.origin.extend(ray.t_near)));
                    x.write_to_slice(&mut packet.org_x[first..]);
                    y.write_to_slice(&mut packet.org_y[first..]);
                    z.write_to_slice(&mut packet.org_z[first..]);
                    t.write_to_slice(&mut packet.tnear[first..]);
                    let [x, y, z, t] = transposed(four.map(|ray| ray.direction.extend(ray.t_far)));
                    x.write_to_slice(&mut packet.dir_x[first..]);
                    y.write_to_slice(&mut packet.dir_y[first..]);
                    z.write_to_slice(&mut packet.dir_z[first..]);
                    t.write_to_slice(&mut packet.tfar[first..]);
                }
            }

            /// Fills up an incomplete packet with a ray that is there; its lanes are masked.
            fn padded(rays: &[Ray]) -> [Ray; $n] {
                std::array::from_fn(|lane| *rays.get(lane).unwrap_or(&rays[0]))
            }

            /// # Safety
            /// As [`super::closest_hit`].
            pub unsafe fn closest_hits(
                scene: sys::RTCScene,
                rays: &[Ray],
                hits: &mut [Hit],
                coherence: Coherence,
            ) {
                let mut arguments = sys::RTCIntersectArguments {
                    flags: query_flags(coherence),
                    feature_mask: sys::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
                    ..Default::default()
                };
                let mut query =
                    sys::$ray_hit { ray: fresh_ray!($ray, [!0; $n]), ..Default::default() };
                let mut trace = |rays: &[Ray; $n], valid: &Valid, hits: &mut [Hit; $n]| {
                    stage(rays, &mut query.ray);
                    // A lane that hits nothing keeps these: together with its distance, a miss.
                    query.hit.geomID = [sys::RTC_INVALID_ID; $n];
                    query.hit.instID[0] = [sys::RTC_INVALID_ID; $n];
                    query.hit.primID = [sys::RTC_INVALID_ID; $n];
                    query.hit.u = [0.0; $n];
                    query.hit.v = [0.0; $n];
                    // SAFETY: the scene is as the caller promised; `valid` and `query` are locals
                    // with at least the alignment that Embree asks for, of the types that the
                    // linked library's header describes.
                    unsafe {
                        sys::$intersect(valid.0.as_ptr(), scene, &mut query, &mut arguments);
                    }
                    for (lane, hit) in hits.iter_mut().enumerate() {
                        let mesh = named(query.hit.instID[0][lane], query.hit.geomID[lane]);
                        let t = query.ray.tfar[lane];
                        *hit = Hit {
                            t: if mesh == sys::RTC_INVALID_ID { f32::INFINITY } else { t },
                            u: query.hit.u[lane],
                            v: query.hit.v[lane],
                            mesh,
                            triangle: query.hit.primID[lane],
                        };
                    }
                };

                let (full, rest) = rays.as_chunks::<$n>();
                let (full_hits, rest_hits) = hits.as_chunks_mut::<$n>();
                let all = Valid([-1; $n]);
                for (rays, hits) in full.iter().zip(full_hits) {
                    trace(rays, &all, hits);
                }
                if rest.len() > MAX_SINGLES {
                    let mut padded_hits = [Hit::MISS; $n];
                    trace(&padded(rest), &Valid::first(rest.len()), &mut padded_hits);
                    rest_hits.copy_from_slice(&padded_hits[..rest.len()]);
                } else {
                    for (ray, hit) in rest.iter().zip(rest_hits) {
                        // SAFETY: the caller's promise about the scene is handed on.
                        *hit = unsafe { super::closest_hit(scene, ray) };
                    }
                }
            }

            /// # Safety
            /// As [`super::closest_hit`].
            pub unsafe fn occlusions(
                scene: sys::RTCScene,
                rays: &[Ray],
                occluded: &mut [bool],
                coherence: Coherence,
            ) {
                let mut arguments = sys::RTCOccludedArguments {
                    flags: query_flags(coherence),
                    feature_mask: sys::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
                    ..Default::default()
                };
                let mut query = fresh_ray!($ray, [!0; $n]);
                let mut trace = |rays: &[Ray; $n], valid: &Valid| {
                    stage(rays, &mut query);
                    // SAFETY: as in `closest_hits`.
                    unsafe {
                        sys::$occluded(valid.0.as_ptr(), scene, &mut query, &mut arguments);
                    }
                    query.tfar.map(is_hit)
                };

                let (full, rest) = rays.as_chunks::<$n>();
                let (full_occluded, rest_occluded) = occluded.as_chunks_mut::<$n>();
                let all = Valid([-1; $n]);
                for (rays, occluded) in full.iter().zip(full_occluded) {
                    *occluded = trace(rays, &all);
                }
                if rest.len() > MAX_SINGLES {
                    let answers = trace(&padded(rest), &Valid::first(rest.len()));
                    rest_occluded.copy_from_slice(&answers[..rest.len()]);
                } else {
                    for (ray, occluded) in rest.iter().zip(rest_occluded) {
                        // SAFETY: the caller's promise about the scene is handed on.
                        *occluded = unsafe { super::is_occluded(scene, ray) };
                    }
                }
            }
        }
    };
}

packets!(packet4, 4, RTCRay4, RTCRayHit4, rtcIntersect4, rtcOccluded4);
packets!(packet8, 8, RTCRay8, RTCRayHit8, rtcIntersect8, rtcOccluded8);
packets!(packet16, 16, RTCRay16, RTCRayHit16, rtcIntersect16, rtcOccluded16);
