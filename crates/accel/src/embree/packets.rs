//! Ray queries: the renderer's hot path. No allocation and no error polling. Our packets have
//! Embree's order (all x of the origins, all y, ...), so staging one is a copy of eight registers.
//!
//! Packets serve unrelated rays as well. With AVX-512 and 36 to 217,000 triangles, packets of 16
//! are 4.4 to 6.8 times as fast as single rays if the rays are coherent. They are 1.0 to 1.3 times
//! as fast if not (`cargo bench --bench trace`).

use super::Device;
use super::guard::Guarded;
use super::single::{closest_hit, far_end, fresh_ray, is_hit, is_occluded, named};
use crate::lanes::vectorized;
use crate::lanes::{LANES, Mask};
use crate::packet::used;
use crate::{Coherence, Hit, HitPacket, Ray, RayPacket};
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

/// The closest hit of a ray, in the last lane of a packet that repeats it in every lane; `None` if
/// Embree wrote behind the query.
///
/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn guarded(scene: sys::RTCScene, size: PacketSize, ray: &Ray) -> Option<Hit> {
    let rays = RayPacket::of(&[*ray]);
    // SAFETY: the caller's promise about the scene is handed on.
    let hits = unsafe {
        match size {
            PacketSize::Sixteen => packet16::guarded(scene, &rays),
            PacketSize::Eight => packet8::guarded(scene, &rays),
            PacketSize::Four => packet4::guarded(scene, &rays),
        }
    };
    Some(hits?.get(size.rays() - 1))
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
    vectorized(
        #[inline(always)]
        || {
            // SAFETY: the caller's promise about the scene is handed on.
            unsafe {
                match size {
                    PacketSize::Sixteen => packet16::intersect(scene, rays, hits, coherence),
                    PacketSize::Eight => packet8::intersect(scene, rays, hits, coherence),
                    PacketSize::Four => packet4::intersect(scene, rays, hits, coherence),
                }
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
    vectorized(
        #[inline(always)]
        || {
            // SAFETY: the caller's promise about the scene is handed on.
            unsafe {
                match size {
                    PacketSize::Sixteen => packet16::occlude(scene, rays, occluded, coherence),
                    PacketSize::Eight => packet8::occlude(scene, rays, occluded, coherence),
                    PacketSize::Four => packet4::occlude(scene, rays, occluded, coherence),
                }
            }
        },
    );
}

/// Up to this many rays of a packet are traced as single rays.
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

            /// A lane is traced if its entry is -1. Embree requires the packet's alignment.
            #[repr(C, align(64))]
            struct Valid([i32; $n]);

            impl Valid {
                #[inline(always)]
                fn first(count: usize) -> Self {
                    Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
                }
            }

            /// Lanes of ours that make up a packet of Embree's.
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
                packet.tfar = part(&rays.t_far, first).map(far_end);
            }

            #[inline(always)]
            fn fresh() -> sys::$ray_hit {
                sys::$ray_hit { ray: fresh_ray!($ray, [!0; $n]), ..Default::default() }
            }

            /// Resets the hits: a lane that hits nothing keeps these values, a miss.
            #[inline(always)]
            fn clear(query: &mut sys::$ray_hit) {
                query.hit.geomID = [sys::RTC_INVALID_ID; $n];
                query.hit.instID[0] = [sys::RTC_INVALID_ID; $n];
                query.hit.primID = [sys::RTC_INVALID_ID; $n];
                query.hit.u = [0.0; $n];
                query.hit.v = [0.0; $n];
            }

            #[inline(always)]
            fn answer(query: &sys::$ray_hit, hits: &mut HitPacket, first: usize) {
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

            /// The hits of the first rays of a packet; `None` if Embree wrote behind the query.
            ///
            /// # Safety
            /// As [`super::closest_hit`].
            pub unsafe fn guarded(scene: sys::RTCScene, rays: &RayPacket) -> Option<HitPacket> {
                let mut query = fresh();
                stage(rays, 0, &mut query.ray);
                clear(&mut query);
                let mut query = Guarded::new(query);
                let valid = Valid::first($n);
                // SAFETY: as in `intersect`, but that the library may stray into the guard.
                unsafe {
                    sys::$intersect(valid.0.as_ptr(), scene, query.as_mut_ptr(), null_mut());
                }
                let mut hits = HitPacket::default();
                answer(&query.get()?, &mut hits, 0);
                Some(hits)
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
                let mut query = fresh();
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
                        clear(&mut query);
                        let valid = Valid::first(active);
                        // SAFETY: the scene is as the caller promised; `valid` and `query` are
                        // locals with at least the alignment that Embree asks for, of the header's
                        // types, in which the library stays (`guard`).
                        unsafe {
                            sys::$intersect(valid.0.as_ptr(), scene, &mut query, &mut arguments);
                        }
                        answer(&query, hits, first);
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
