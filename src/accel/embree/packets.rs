//! Ray queries: the renderer's hot path. No allocation and no error polling. Our packets have
//! Embree's order (all x of the origins, all y, ...), so staging one is a copy of eight registers.
//!
//! Packets serve unrelated rays as well: with AVX-512 and 36 to 217,000 triangles, packets of 16 are
//! 4.4 to 6.8 times as fast as single rays on coherent rays and 1.0 to 1.3 times on incoherent ones
//! (`cargo bench --bench trace`).

use super::Device;
use crate::accel::packet::used;
use crate::accel::{Coherence, Hit, HitPacket, Ray, RayPacket};
use crate::lanes::simd::vectorized;
use crate::lanes::{LANES, Mask};
use embree4_sys as sys;
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
pub(super) unsafe fn intersect(
    scene: sys::RTCScene,
    size: PacketSize,
    rays: (&[RayPacket], usize),
    hits: &mut [HitPacket],
    coherence: Coherence,
) {
    // SAFETY: the caller's promise about the scene is handed on.
    vectorized(
        #[inline(always)]
        |_| unsafe {
            match size {
                PacketSize::Sixteen => packet16::intersect(scene, rays, hits, coherence),
                PacketSize::Eight => packet8::intersect(scene, rays, hits, coherence),
                PacketSize::Four => packet4::intersect(scene, rays, hits, coherence),
            }
        },
    );
}

/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn occlude(
    scene: sys::RTCScene,
    size: PacketSize,
    rays: (&[RayPacket], usize),
    occluded: &mut [Mask],
    coherence: Coherence,
) {
    // SAFETY: the caller's promise about the scene is handed on.
    vectorized(
        #[inline(always)]
        |_| unsafe {
            match size {
                PacketSize::Sixteen => packet16::occlude(scene, rays, occluded, coherence),
                PacketSize::Eight => packet8::occlude(scene, rays, occluded, coherence),
                PacketSize::Four => packet4::occlude(scene, rays, occluded, coherence),
            }
        },
    );
}

/// So few rays of a packet are traced one by one.
const MAX_SINGLES: usize = 2;

fn query_flags(coherence: Coherence) -> sys::RTCRayQueryFlags {
    match coherence {
        Coherence::Coherent => sys::RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT,
        Coherence::Incoherent => sys::RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_INCOHERENT,
    }
}

macro_rules! packets {
    ($name:ident, $n:literal, $ray:ident, $ray_hit:ident, $intersect:ident, $occluded:ident) => {
        mod $name {
            use super::*;

            /// One lane is traced if its entry is -1. Embree wants this as aligned as the packet.
            #[repr(C, align(64))]
            struct Valid([i32; $n]);

            impl Valid {
                #[inline(always)]
                fn first(count: usize) -> Self {
                    Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
                }
            }

            /// Some of our lanes as Embree's.
            #[inline(always)]
            fn part<T>(lanes: &[T; LANES], first: usize) -> &[T; $n] {
                lanes[first..first + $n].try_into().unwrap()
            }

            #[inline(always)]
            fn part_mut<T>(lanes: &mut [T; LANES], first: usize) -> &mut [T; $n] {
                (&mut lanes[first..first + $n]).try_into().unwrap()
            }

            #[inline(always)]
            fn stage(rays: &RayPacket, first: usize, packet: &mut sys::$ray) {
                packet.org_x = *part(&rays.origin.x, first);
                packet.org_y = *part(&rays.origin.y, first);
                packet.org_z = *part(&rays.origin.z, first);
                packet.tnear = *part(&rays.t_near, first);
                packet.dir_x = *part(&rays.direction.x, first);
                packet.dir_y = *part(&rays.direction.y, first);
                packet.dir_z = *part(&rays.direction.z, first);
                packet.tfar = *part(&rays.t_far, first);
            }

            /// # Safety
            /// As [`super::closest_hit`].
            #[inline(always)] // vectorized
            pub unsafe fn intersect(
                scene: sys::RTCScene,
                (rays, count): (&[RayPacket], usize),
                hits: &mut [HitPacket],
                coherence: Coherence,
            ) {
                let mut arguments = sys::RTCIntersectArguments {
                    flags: query_flags(coherence),
                    feature_mask: sys::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
                    ..Default::default()
                };
                let mut query =
                    sys::$ray_hit { ray: fresh_ray!($ray, [!0; $n]), ..Default::default() };
                for ((rays, hits), lanes) in rays.iter().zip(hits).zip(used(count, rays.len())) {
                    for first in lanes.clone().step_by($n) {
                        let active = (lanes.end - first).min($n);
                        if active <= MAX_SINGLES {
                            for lane in first..first + active {
                                // SAFETY: the caller's promise about the scene is handed on.
                                let hit = unsafe { closest_hit(scene, &rays.get(lane)) };
                                hits.set(lane, &hit);
                            }
                            continue;
                        }
                        stage(rays, first, &mut query.ray);
                        // A lane that hits nothing keeps these: together with its distance, a miss.
                        query.hit.geomID = [sys::RTC_INVALID_ID; $n];
                        query.hit.instID[0] = [sys::RTC_INVALID_ID; $n];
                        query.hit.primID = [sys::RTC_INVALID_ID; $n];
                        query.hit.u = [0.0; $n];
                        query.hit.v = [0.0; $n];
                        let valid = Valid::first(active);
                        // SAFETY: the scene is as the caller promised; `valid` and `query` are
                        // locals with at least the alignment that Embree asks for, of the types that
                        // the linked library's header describes.
                        unsafe {
                            sys::$intersect(valid.0.as_ptr(), scene, &mut query, &mut arguments);
                        }
                        let (ray, hit) = (&query.ray, &query.hit);
                        let mesh = part_mut(&mut hits.mesh, first);
                        let t = part_mut(&mut hits.t, first);
                        for lane in 0..$n {
                            mesh[lane] = named(hit.instID[0][lane], hit.geomID[lane]);
                            let missed = mesh[lane] == sys::RTC_INVALID_ID;
                            t[lane] = if missed { f32::INFINITY } else { ray.tfar[lane] };
                        }
                        *part_mut(&mut hits.u, first) = hit.u;
                        *part_mut(&mut hits.v, first) = hit.v;
                        *part_mut(&mut hits.triangle, first) = hit.primID;
                    }
                }
            }

            /// # Safety
            /// As [`super::closest_hit`].
            #[inline(always)] // vectorized
            pub unsafe fn occlude(
                scene: sys::RTCScene,
                (rays, count): (&[RayPacket], usize),
                occluded: &mut [Mask],
                coherence: Coherence,
            ) {
                let mut arguments = sys::RTCOccludedArguments {
                    flags: query_flags(coherence),
                    feature_mask: sys::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
                    ..Default::default()
                };
                let mut query = fresh_ray!($ray, [!0; $n]);
                for ((rays, occluded), lanes) in
                    rays.iter().zip(occluded).zip(used(count, rays.len()))
                {
                    for first in lanes.clone().step_by($n) {
                        let active = (lanes.end - first).min($n);
                        if active <= MAX_SINGLES {
                            for lane in first..first + active {
                                // SAFETY: the caller's promise about the scene is handed on.
                                occluded[lane] = unsafe { is_occluded(scene, &rays.get(lane)) };
                            }
                            continue;
                        }
                        stage(rays, first, &mut query);
                        let valid = Valid::first(active);
                        // SAFETY: as in `intersect`.
                        unsafe {
                            sys::$occluded(valid.0.as_ptr(), scene, &mut query, &mut arguments);
                        }
                        *part_mut(occluded, first) = query.tfar.map(is_hit);
                    }
                }
            }
        }
    };
}

packets!(packet4, 4, RTCRay4, RTCRayHit4, rtcIntersect4, rtcOccluded4);
packets!(packet8, 8, RTCRay8, RTCRayHit8, rtcIntersect8, rtcOccluded8);
packets!(packet16, 16, RTCRay16, RTCRayHit16, rtcIntersect16, rtcOccluded16);
