//! Embree's point queries over points.

use embree4_sys::*;
use glam::Vec3;
use std::ffi::c_void;

/// Points as a user geometry of empty boxes.
pub struct RawPoints<'a> {
    device: RTCDevice,
    scene: RTCScene,
    points: &'a [Vec3],
}

/// One query under way.
struct Query<'a, F> {
    points: &'a [Vec3],
    center: Vec3,
    radius2: f32,
    found: F,
}

impl<'a> RawPoints<'a> {
    pub fn new(points: &'a [Vec3]) -> Self {
        // SAFETY: Embree's set-up sequence; the points outlive the scene.
        unsafe {
            let device = rtcNewDevice(std::ptr::null());
            let scene = rtcNewScene(device);
            let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_USER);
            rtcSetGeometryUserPrimitiveCount(geometry, points.len() as u32);
            rtcSetGeometryUserData(geometry, points.as_ptr().cast_mut().cast());
            rtcSetGeometryBoundsFunction(geometry, Some(bounds), std::ptr::null_mut());
            rtcCommitGeometry(geometry);
            rtcAttachGeometry(scene, geometry);
            rtcReleaseGeometry(geometry);
            rtcCommitScene(scene);
            assert_eq!(rtcGetDeviceError(device), RTCError::RTC_ERROR_NONE);
            Self { device, scene, points }
        }
    }

    /// Calls `found` with the index of each point within `radius` of `center`.
    #[inline]
    pub fn within<F: FnMut(u32)>(&self, center: Vec3, radius: f32, found: F) {
        let Vec3 { x, y, z } = center;
        // Wider by more than rounding: the callback decides.
        let mut query = RTCPointQuery { x, y, z, time: 0.0, radius: radius * (1.0 + 1e-6) };
        let mut context = RTCPointQueryContext { instID: [!0], ..Default::default() };
        let mut state = Query { points: self.points, center, radius2: radius * radius, found };
        // SAFETY: a committed scene; `visit` is the callback for this type of state.
        unsafe {
            let state = (&raw mut state).cast();
            rtcPointQuery(self.scene, &mut query, &mut context, Some(visit::<F>), state);
        }
    }
}

impl Drop for RawPoints<'_> {
    fn drop(&mut self) {
        // SAFETY: released once; no query is under way.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}

unsafe extern "C" fn bounds(arguments: *const RTCBoundsFunctionArguments) {
    // SAFETY: Embree gives valid arguments; the user data is the points.
    unsafe {
        let arguments = &*arguments;
        let points: *const Vec3 = arguments.geometryUserPtr.cast_const().cast();
        let Vec3 { x, y, z } = *points.add(arguments.primID as usize);
        let bounds = &mut *arguments.bounds_o;
        (bounds.lower_x, bounds.lower_y, bounds.lower_z) = (x, y, z);
        (bounds.upper_x, bounds.upper_y, bounds.upper_z) = (x, y, z);
    }
}

unsafe extern "C" fn visit<F: FnMut(u32)>(arguments: *mut RTCPointQueryFunctionArguments) -> bool {
    // SAFETY: Embree gives valid arguments; `within` passed a state of this type.
    let (state, point) = unsafe {
        let state: *mut c_void = (*arguments).userPtr;
        (&mut *state.cast::<Query<F>>(), (*arguments).primID)
    };
    if state.points[point as usize].distance_squared(state.center) <= state.radius2 {
        (state.found)(point);
    }
    false
}
