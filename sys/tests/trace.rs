//! The raw API as bound here, end to end: a device, a triangle, a ray, and every bound struct's
//! layout as the linked library sees it.

use embree4_sys::*;
use std::ptr::null_mut;

/// A scene with the triangle (0,0,0) (1,0,0) (0,1,0), with its device.
unsafe fn triangle_scene() -> (RTCDevice, RTCScene) {
    unsafe {
        let device = rtcNewDevice(std::ptr::null());
        assert!(!device.is_null(), "no device: {:?}", rtcGetDeviceError(null_mut()));
        let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
        let positions = rtcSetNewGeometryBuffer(
            geometry,
            RTCBufferType::RTC_BUFFER_TYPE_VERTEX,
            0,
            RTCFormat::RTC_FORMAT_FLOAT3,
            12,
            3,
        );
        positions.cast::<[f32; 9]>().write([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let indices = rtcSetNewGeometryBuffer(
            geometry,
            RTCBufferType::RTC_BUFFER_TYPE_INDEX,
            0,
            RTCFormat::RTC_FORMAT_UINT3,
            12,
            1,
        );
        indices.cast::<[u32; 3]>().write([0, 1, 2]);
        rtcCommitGeometry(geometry);
        let scene = rtcNewScene(device);
        assert_eq!(rtcAttachGeometry(scene, geometry), 0);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
        assert_eq!(rtcGetDeviceError(device), RTCError::RTC_ERROR_NONE);
        (device, scene)
    }
}

fn ray_at(x: f32, y: f32) -> RTCRayHit {
    let mut ray_hit = RTCRayHit {
        ray: RTCRay {
            org_x: x,
            org_y: y,
            org_z: -2.0,
            dir_z: 1.0,
            tfar: f32::INFINITY,
            mask: !0,
            ..Default::default()
        },
        ..Default::default()
    };
    ray_hit.hit.geomID = RTC_INVALID_ID;
    ray_hit.hit.primID = RTC_INVALID_ID;
    ray_hit.hit.instID = [RTC_INVALID_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    ray_hit
}

#[test]
fn traces_a_ray() {
    unsafe {
        let (device, scene) = triangle_scene();
        let mut hit = ray_at(0.25, 0.5);
        rtcIntersect1(scene, &mut hit, null_mut());
        assert_eq!((hit.hit.geomID, hit.hit.primID), (0, 0));
        assert_eq!(hit.ray.tfar, 2.0);
        assert_eq!((hit.hit.u, hit.hit.v), (0.25, 0.5));
        let mut miss = ray_at(0.75, 0.75);
        rtcIntersect1(scene, &mut miss, null_mut());
        assert_eq!(miss.hit.geomID, RTC_INVALID_ID);
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
}

/// The library must write inside the struct that the header describes, and nowhere else. A header
/// from another version of Embree than the library fails here.
#[test]
fn the_library_stays_inside_the_struct() {
    #[repr(C, align(64))]
    struct Guarded {
        before: [u32; 16],
        inside: RTCRayHit,
        after: [u32; 16],
    }
    const CANARY: u32 = 0xdead_beef;
    unsafe {
        let (device, scene) = triangle_scene();
        let mut guarded =
            Guarded { before: [CANARY; 16], inside: ray_at(0.25, 0.5), after: [CANARY; 16] };
        rtcIntersect1(scene, &mut guarded.inside, null_mut());
        assert_eq!(guarded.inside.hit.geomID, 0);
        assert_eq!(guarded.inside.hit.instID[0], RTC_INVALID_ID);
        assert_eq!(guarded.before, [CANARY; 16]);
        assert_eq!(guarded.after, [CANARY; 16]);
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
}

#[test]
fn the_library_is_not_older_than_the_header() {
    unsafe {
        let device = rtcNewDevice(std::ptr::null());
        let version = |property| rtcGetDeviceProperty(device, property);
        let library = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION);
        let major = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MAJOR);
        assert_eq!(major, RTC_VERSION_MAJOR as isize);
        assert!(library >= RTC_VERSION as isize, "library {library}, header {RTC_VERSION}");
        rtcReleaseDevice(device);
    }
}
