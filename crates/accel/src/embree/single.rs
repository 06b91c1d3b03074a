//! Queries of single rays, and helpers that packets share.

use super::guard::Guarded;
use crate::{Hit, Ray};
use embree4_sys as sys;
use std::ptr::null_mut;

/// A ray or packet without its geometry: visible to all masks, at time 0, no flags.
macro_rules! fresh_ray {
    ($ray:ident, $mask:expr) => {
        sys::$ray { mask: $mask, ..Default::default() }
    };
}
pub(super) use fresh_ray;

/// The far end of a ray. Embree marks occluded rays by minus infinity there. A ray with that or NaN
/// gets the smallest finite number instead: nothing lies before that either.
#[inline(always)]
pub(super) fn far_end(t_far: f32) -> f32 {
    if t_far > f32::MIN { t_far } else { f32::MIN }
}

/// Returns true if Embree marked the ray as occluded.
#[inline(always)]
pub(super) fn is_hit(t_far: f32) -> bool {
    t_far == f32::NEG_INFINITY
}

/// The mesh index of a hit. An instance has the index of its first mesh, and the builder has
/// counted all its meshes: the sum wraps only if a library writes to other addresses, which `guard`
/// detects.
#[inline(always)]
pub(super) fn named(instance: u32, geometry: u32) -> u32 {
    if instance == sys::RTC_INVALID_ID { geometry } else { instance.wrapping_add(geometry) }
}

fn occlusion(ray: &Ray) -> sys::RTCRay {
    sys::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        tnear: ray.t_near,
        dir_x: ray.direction.x,
        dir_y: ray.direction.y,
        dir_z: ray.direction.z,
        tfar: far_end(ray.t_far),
        ..fresh_ray!(RTCRay, !0)
    }
}

fn query(ray: &Ray) -> sys::RTCRayHit {
    let mut query = sys::RTCRayHit { ray: occlusion(ray), ..Default::default() };
    query.hit.geomID = sys::RTC_INVALID_ID;
    query.hit.instID[0] = sys::RTC_INVALID_ID;
    query
}

fn answer(query: &sys::RTCRayHit) -> Hit {
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

/// The closest hit of a ray.
///
/// # Safety
/// `scene` must be committed, and stay alive and unchanged during the call.
pub(super) unsafe fn closest_hit(scene: sys::RTCScene, ray: &Ray) -> Hit {
    let mut query = query(ray);
    // SAFETY: the scene is as the caller promised. `query` is an aligned local of the header's
    // type, in which the library stays (`guard`). Null arguments mean Embree's defaults.
    unsafe { sys::rtcIntersect1(scene, &mut query, null_mut()) };
    answer(&query)
}

/// Returns true if anything is hit.
///
/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn is_occluded(scene: sys::RTCScene, ray: &Ray) -> bool {
    let mut query = occlusion(ray);
    // SAFETY: as in `closest_hit`.
    unsafe { sys::rtcOccluded1(scene, &mut query, null_mut()) };
    is_hit(query.tfar)
}

/// The closest hit; `None` if Embree wrote behind the query.
///
/// # Safety
/// As [`closest_hit`].
pub(super) unsafe fn guarded(scene: sys::RTCScene, ray: &Ray) -> Option<Hit> {
    let mut query = Guarded::new(query(ray));
    // SAFETY: as in `closest_hit`, but that the library may stray into the guard.
    unsafe { sys::rtcIntersect1(scene, query.as_mut_ptr(), null_mut()) };
    Some(answer(&query.get()?))
}
