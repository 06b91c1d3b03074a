//! The raw API as bound here, end to end: a device, a triangle, a ray, and every bound struct's
//! layout as the linked library sees it.

use embree4_sys::*;
use std::ptr::null_mut;

/// valgrind knows no AVX-512; `scripts/valgrind.sh` asks for another instruction set here.
fn new_device() -> RTCDevice {
    let config = std::env::var("BDPM_TEST_EMBREE").unwrap_or_default();
    let config = std::ffi::CString::new(config).unwrap();
    unsafe { rtcNewDevice(config.as_ptr()) }
}

/// A scene with the triangle (0,0,0) (1,0,0) (0,1,0), with its device.
unsafe fn triangle_scene() -> (RTCDevice, RTCScene) {
    unsafe {
        let device = new_device();
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

/// Embree divides by approximate reciprocals, whose last bits differ between processors.
fn assert_close(found: [f32; 3], expected: [f32; 3]) {
    let close = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(close, "{found:?} instead of {expected:?}");
}

#[test]
fn traces_a_ray() {
    unsafe {
        let (device, scene) = triangle_scene();
        let mut hit = ray_at(0.25, 0.5);
        rtcIntersect1(scene, &mut hit, null_mut());
        assert_eq!((hit.hit.geomID, hit.hit.primID), (0, 0));
        assert_close([hit.ray.tfar, hit.hit.u, hit.hit.v], [2.0, 0.25, 0.5]);
        let mut miss = ray_at(0.75, 0.75);
        rtcIntersect1(scene, &mut miss, null_mut());
        assert_eq!(miss.hit.geomID, RTC_INVALID_ID);
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
}

const CANARY: u32 = 0xdead_beef;

/// A struct between two stretches of memory that nobody may write to.
#[repr(C, align(64))]
struct Guarded<T> {
    before: [u32; 64],
    inside: T,
    after: [u32; 64],
}

impl<T> Guarded<T> {
    fn new(inside: T) -> Self {
        Self { before: [CANARY; 64], inside, after: [CANARY; 64] }
    }

    fn assert_intact(&self) {
        assert_eq!((self.before, self.after), ([CANARY; 64], [CANARY; 64]));
    }
}

/// The library must write inside the struct that the header describes, and nowhere else. A header
/// from another version of Embree than the library fails here.
#[test]
fn the_library_stays_inside_a_single_ray() {
    unsafe {
        let (device, scene) = triangle_scene();
        let mut guarded = Guarded::new(ray_at(0.25, 0.5));
        rtcIntersect1(scene, &mut guarded.inside, null_mut());
        assert_eq!(guarded.inside.hit.geomID, 0);
        assert_eq!(guarded.inside.hit.instID[0], RTC_INVALID_ID);
        guarded.assert_intact();
        let mut guarded = Guarded::new(ray_at(0.25, 0.5).ray);
        rtcOccluded1(scene, &mut guarded.inside, null_mut());
        assert_eq!(guarded.inside.tfar, f32::NEG_INFINITY);
        guarded.assert_intact();
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
}

macro_rules! packet_stays_inside {
    ($test:ident, $n:literal, $packet:ident, $intersect:ident, $occluded:ident) => {
        /// As for single rays; every other lane is masked and must stay as it is.
        #[test]
        fn $test() {
            #[repr(align(64))]
            struct Valid([i32; $n]);
            unsafe {
                let (device, scene) = triangle_scene();
                let valid = Valid(std::array::from_fn(|lane| if lane % 2 == 0 { -1 } else { 0 }));
                let mut packet = $packet::default();
                packet.ray.org_x = [0.25; $n];
                packet.ray.org_y = [0.5; $n];
                packet.ray.org_z = [-2.0; $n];
                packet.ray.dir_z = [1.0; $n];
                packet.ray.tfar = [f32::INFINITY; $n];
                packet.ray.mask = [!0; $n];
                packet.hit.primID = [RTC_INVALID_ID; $n];
                packet.hit.geomID = [RTC_INVALID_ID; $n];
                packet.hit.instID[0] = [RTC_INVALID_ID; $n];

                let mut guarded = Guarded::new(packet);
                $intersect(valid.0.as_ptr(), scene, &mut guarded.inside, null_mut());
                guarded.assert_intact();
                let mut rays = Guarded::new(packet.ray);
                $occluded(valid.0.as_ptr(), scene, &mut rays.inside, null_mut());
                rays.assert_intact();
                for lane in 0..$n {
                    let (ray, hit) = (&guarded.inside.ray, &guarded.inside.hit);
                    if lane % 2 == 0 {
                        assert_eq!((hit.geomID[lane], hit.primID[lane]), (0, 0));
                        assert_close([ray.tfar[lane], hit.u[lane], hit.v[lane]], [2.0, 0.25, 0.5]);
                        assert_eq!(rays.inside.tfar[lane], f32::NEG_INFINITY);
                    } else {
                        assert_eq!(hit.geomID[lane], RTC_INVALID_ID);
                        assert_eq!(ray.tfar[lane], f32::INFINITY);
                        assert_eq!(rays.inside.tfar[lane], f32::INFINITY);
                    }
                }
                rtcReleaseScene(scene);
                rtcReleaseDevice(device);
            }
        }
    };
}

packet_stays_inside!(
    the_library_stays_inside_packets_of_4,
    4,
    RTCRayHit4,
    rtcIntersect4,
    rtcOccluded4
);
packet_stays_inside!(
    the_library_stays_inside_packets_of_8,
    8,
    RTCRayHit8,
    rtcIntersect8,
    rtcOccluded8
);
packet_stays_inside!(
    the_library_stays_inside_packets_of_16,
    16,
    RTCRayHit16,
    rtcIntersect16,
    rtcOccluded16
);

#[test]
fn the_library_is_not_older_than_the_header() {
    unsafe {
        let device = new_device();
        let version = |property| rtcGetDeviceProperty(device, property);
        let library = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION);
        let major = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MAJOR);
        assert_eq!(major, RTC_VERSION_MAJOR as isize);
        assert!(library >= RTC_VERSION as isize, "library {library}, header {RTC_VERSION}");
        rtcReleaseDevice(device);
    }
}
