//! The raw API as bound here, end to end: a device, a triangle and an instance of it, a ray, and
//! every bound struct's layout as the linked library sees it.
#![allow(unsafe_code)] // what is tested

use embree4_sys::*;
use std::ptr::null_mut;

/// valgrind knows no AVX-512; `scripts/valgrind.sh` asks for another instruction set here.
fn new_device() -> RTCDevice {
    let config = std::env::var("BDPM_TEST_EMBREE").unwrap_or_default();
    let config = std::ffi::CString::new(config).unwrap();
    // SAFETY: the text ends in a zero byte and outlives the call.
    let device = unsafe { rtcNewDevice(config.as_ptr()) };
    // SAFETY: null asks for this thread's error without a device.
    assert!(!device.is_null(), "no device: {:?}", unsafe { rtcGetDeviceError(null_mut()) });
    device
}

/// The triangle (0,0,0) (1,0,0) (0,1,0) as geometry 0, and an instance of it as geometry 1, moved
/// by [`INSTANCE_AT`] along x.
struct Scene {
    device: RTCDevice,
    triangle: RTCScene,
    handle: RTCScene,
}

const INSTANCE_AT: f32 = 8.0;

impl Scene {
    fn new() -> Self {
        let device = new_device();
        // SAFETY: Embree's set-up sequence on valid handles of one device, used by this thread
        // only; both buffers are as long as what is written to them, and indices are below three.
        unsafe {
            let triangle = rtcNewScene(device);
            let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
            let (vertex, float3) =
                (RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCFormat::RTC_FORMAT_FLOAT3);
            rtcSetNewGeometryBuffer(geometry, vertex, 0, float3, 12, 3)
                .cast::<[f32; 9]>()
                .write([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
            let (index, uint3) =
                (RTCBufferType::RTC_BUFFER_TYPE_INDEX, RTCFormat::RTC_FORMAT_UINT3);
            rtcSetNewGeometryBuffer(geometry, index, 0, uint3, 12, 1)
                .cast::<[u32; 3]>()
                .write([0, 1, 2]);
            rtcCommitGeometry(geometry);
            assert_eq!(rtcAttachGeometry(triangle, geometry), 0);
            rtcCommitScene(triangle);

            let handle = rtcNewScene(device);
            assert_eq!(rtcAttachGeometry(handle, geometry), 0);
            rtcReleaseGeometry(geometry);
            let instance = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_INSTANCE);
            rtcSetGeometryInstancedScene(instance, triangle);
            let columns: [f32; 12] = [1., 0., 0., 0., 1., 0., 0., 0., 1., INSTANCE_AT, 0., 0.];
            let format = RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR;
            rtcSetGeometryTransform(instance, 0, format, columns.as_ptr().cast());
            rtcCommitGeometry(instance);
            assert_eq!(rtcAttachGeometry(handle, instance), 1);
            rtcReleaseGeometry(instance);
            rtcCommitScene(handle);
            assert_eq!(rtcGetDeviceError(device), RTCError::RTC_ERROR_NONE);
            Self { device, triangle, handle }
        }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: released once each, and no query is under way.
        unsafe {
            rtcReleaseScene(self.handle);
            rtcReleaseScene(self.triangle);
            rtcReleaseDevice(self.device);
        }
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
    let scene = Scene::new();
    let trace = |x, y| {
        let mut query = ray_at(x, y);
        // SAFETY: a committed scene; an aligned local of the header's type; default arguments.
        unsafe { rtcIntersect1(scene.handle, &mut query, null_mut()) };
        query
    };
    let hit = trace(0.25, 0.5);
    assert_eq!((hit.hit.geomID, hit.hit.primID, hit.hit.instID[0]), (0, 0, RTC_INVALID_ID));
    assert_close([hit.ray.tfar, hit.hit.u, hit.hit.v], [2.0, 0.25, 0.5]);
    let hit = trace(INSTANCE_AT + 0.25, 0.5);
    assert_eq!((hit.hit.geomID, hit.hit.primID, hit.hit.instID[0]), (0, 0, 1));
    assert_close([hit.ray.tfar, hit.hit.u, hit.hit.v], [2.0, 0.25, 0.5]);
    assert_eq!(trace(0.75, 0.75).hit.geomID, RTC_INVALID_ID);
}

const CANARY: u32 = 0xdead_beef;

/// A struct between two stretches of memory that nobody may write to.
#[repr(C, align(64))]
struct Guarded<T> {
    before: [u32; 64],
    inside: T,
    after: [u32; 1024],
}

impl<T> Guarded<T> {
    fn new(inside: T) -> Self {
        Self { before: [CANARY; 64], inside, after: [CANARY; 1024] }
    }

    /// Take the struct's address from the whole: the words beside it belong to this test.
    fn pointer(&mut self) -> *mut T {
        let whole = &raw mut *self;
        // SAFETY: a field of a live struct.
        unsafe { &raw mut (*whole).inside }
    }

    fn assert_intact(&self) {
        assert_eq!((self.before, self.after), ([CANARY; 64], [CANARY; 1024]));
    }
}

/// The library must write inside the struct that the header describes, and nowhere else. A header
/// from another version of Embree than the library fails here.
#[test]
fn the_library_stays_inside_a_single_ray() {
    let scene = Scene::new();
    for (x, instance) in [(0.25, RTC_INVALID_ID), (INSTANCE_AT + 0.25, 1)] {
        let mut guarded = Guarded::new(ray_at(x, 0.5));
        // SAFETY: as in `traces_a_ray`; the struct is aligned within its guards.
        unsafe { rtcIntersect1(scene.handle, guarded.pointer(), null_mut()) };
        assert_eq!((guarded.inside.hit.geomID, guarded.inside.hit.instID[0]), (0, instance));
        guarded.assert_intact();
        let mut guarded = Guarded::new(ray_at(x, 0.5).ray);
        // SAFETY: as above.
        unsafe { rtcOccluded1(scene.handle, guarded.pointer(), null_mut()) };
        assert_eq!(guarded.inside.tfar, f32::NEG_INFINITY);
        guarded.assert_intact();
    }
}

macro_rules! packet_stays_inside {
    ($test:ident, $n:literal, $packet:ident, $intersect:ident, $occluded:ident) => {
        /// As for single rays. Every other lane is masked and must stay as it is; of the others,
        /// every other sees the instance.
        #[test]
        fn $test() {
            #[repr(align(64))]
            struct Valid([i32; $n]);
            let scene = Scene::new();
            let valid = Valid(std::array::from_fn(|lane| if lane % 2 == 0 { -1 } else { 0 }));
            let sees_instance = |lane: usize| lane % 4 == 2;
            let mut packet = $packet::default();
            let x = |lane| if sees_instance(lane) { INSTANCE_AT + 0.25 } else { 0.25 };
            packet.ray.org_x = std::array::from_fn(x);
            packet.ray.org_y = [0.5; $n];
            packet.ray.org_z = [-2.0; $n];
            packet.ray.dir_z = [1.0; $n];
            packet.ray.tfar = [f32::INFINITY; $n];
            packet.ray.mask = [!0; $n];
            packet.hit.primID = [RTC_INVALID_ID; $n];
            packet.hit.geomID = [RTC_INVALID_ID; $n];
            packet.hit.instID[0] = [RTC_INVALID_ID; $n];

            let (lanes, scene) = (valid.0.as_ptr(), scene.handle);
            let mut guarded = Guarded::new(packet);
            // SAFETY: a committed scene; mask and packet have the alignment that Embree asks for
            // and the header's types; default arguments.
            unsafe { $intersect(lanes, scene, guarded.pointer(), null_mut()) };
            guarded.assert_intact();
            let mut rays = Guarded::new(packet.ray);
            // SAFETY: as above.
            unsafe { $occluded(lanes, scene, rays.pointer(), null_mut()) };
            rays.assert_intact();
            for lane in 0..$n {
                let (ray, hit) = (&guarded.inside.ray, &guarded.inside.hit);
                if lane % 2 == 0 {
                    assert_eq!((hit.geomID[lane], hit.primID[lane]), (0, 0));
                    let instance = if sees_instance(lane) { 1 } else { RTC_INVALID_ID };
                    assert_eq!(hit.instID[0][lane], instance);
                    assert_close([ray.tfar[lane], hit.u[lane], hit.v[lane]], [2.0, 0.25, 0.5]);
                    assert_eq!(rays.inside.tfar[lane], f32::NEG_INFINITY);
                } else {
                    assert_eq!(hit.geomID[lane], RTC_INVALID_ID);
                    assert_eq!(ray.tfar[lane], f32::INFINITY);
                    assert_eq!(rays.inside.tfar[lane], f32::INFINITY);
                }
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
    let device = new_device();
    // SAFETY: the device is valid until it is released, below.
    let version = |property| unsafe { rtcGetDeviceProperty(device, property) };
    let library = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION);
    let major = version(RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION_MAJOR);
    // SAFETY: released once.
    unsafe { rtcReleaseDevice(device) };
    assert_eq!(major, RTC_VERSION_MAJOR as isize);
    assert!(library >= RTC_VERSION as isize, "library {library}, header {RTC_VERSION}");
}
