//! Embree without the safe layer: the limit that everything above it is measured against.
#![allow(unsafe_code, dead_code)]

pub mod points;

use bdpm::accel::{Coherence, Ray, TriangleMesh};
use embree4_sys::*;

/// A committed scene behind plain handles.
pub struct RawScene {
    device: RTCDevice,
    scene: RTCScene,
}

/// Rays in packets of 16, ready to trace; the last may have fewer.
#[derive(Clone)]
pub struct Packets {
    kind: Kind,
    coherence: Coherence,
    /// Rays of the last packet.
    last: usize,
}

#[derive(Clone)]
enum Kind {
    Closest(Vec<RTCRayHit16>),
    Any(Vec<RTCRay16>),
}

#[repr(align(64))]
struct Valid([i32; 16]);

impl Valid {
    fn first(count: usize) -> Self {
        Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
    }
}

impl RawScene {
    pub fn new<'a>(meshes: impl IntoIterator<Item = TriangleMesh<'a>>) -> Self {
        // SAFETY: Embree's set-up sequence; buffers are filled to the length that they are made
        // with, from meshes that are valid, so that no index reaches beyond the vertices.
        unsafe {
            let device = rtcNewDevice(std::ptr::null());
            let scene = rtcNewScene(device);
            rtcSetSceneBuildQuality(scene, RTCBuildQuality::RTC_BUILD_QUALITY_HIGH);
            for mesh in meshes {
                mesh.validate().expect("benches trace valid meshes");
                let TriangleMesh { positions, triangles } = mesh;
                let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
                let (vertex, float3) =
                    (RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCFormat::RTC_FORMAT_FLOAT3);
                let (index, uint3) =
                    (RTCBufferType::RTC_BUFFER_TYPE_INDEX, RTCFormat::RTC_FORMAT_UINT3);
                rtcSetNewGeometryBuffer(geometry, vertex, 0, float3, 12, positions.len())
                    .cast::<glam::Vec3>()
                    .copy_from_nonoverlapping(positions.as_ptr(), positions.len());
                rtcSetNewGeometryBuffer(geometry, index, 0, uint3, 12, triangles.len())
                    .cast::<[u32; 3]>()
                    .copy_from_nonoverlapping(triangles.as_ptr(), triangles.len());
                rtcCommitGeometry(geometry);
                rtcAttachGeometry(scene, geometry);
                rtcReleaseGeometry(geometry);
            }
            rtcCommitScene(scene);
            assert_eq!(rtcGetDeviceError(device), RTCError::RTC_ERROR_NONE);
            Self { device, scene }
        }
    }

    /// Traces all packets once; they are used up.
    pub fn trace(&self, packets: &mut [Packets]) {
        let all = Valid::first(16);
        let feature_mask = RTCFeatureFlags::RTC_FEATURE_FLAG_ALL;
        for Packets { kind, coherence, last } in packets {
            let (last, flags) = (Valid::first(*last), flags(*coherence));
            let valid = |rest: usize| if rest == 0 { last.0.as_ptr() } else { all.0.as_ptr() };
            match kind {
                Kind::Closest(packets) => {
                    let mut arguments =
                        RTCIntersectArguments { flags, feature_mask, ..Default::default() };
                    let count = packets.len();
                    for (index, packet) in packets.iter_mut().enumerate() {
                        let valid = valid(count - 1 - index);
                        // SAFETY: a committed scene; all structs are aligned and complete.
                        unsafe { rtcIntersect16(valid, self.scene, packet, &mut arguments) };
                    }
                }
                Kind::Any(packets) => {
                    let mut arguments =
                        RTCOccludedArguments { flags, feature_mask, ..Default::default() };
                    let count = packets.len();
                    for (index, packet) in packets.iter_mut().enumerate() {
                        let valid = valid(count - 1 - index);
                        // SAFETY: as above.
                        unsafe { rtcOccluded16(valid, self.scene, packet, &mut arguments) };
                    }
                }
            }
        }
    }
}

impl Drop for RawScene {
    fn drop(&mut self) {
        // SAFETY: released once; no query is under way.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}

fn flags(coherence: Coherence) -> RTCRayQueryFlags {
    match coherence {
        Coherence::Coherent => RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT,
        Coherence::Incoherent => RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_INCOHERENT,
    }
}

impl Packets {
    /// Packets for closest hits.
    pub fn closest(rays: &[Ray], coherence: Coherence) -> Self {
        let packets = rays.chunks(16).map(packet).collect();
        Self { kind: Kind::Closest(packets), coherence, last: last(rays) }
    }

    /// Packets for occlusion.
    pub fn any(rays: &[Ray], coherence: Coherence) -> Self {
        let packets = rays.chunks(16).map(|rays| packet(rays).ray).collect();
        Self { kind: Kind::Any(packets), coherence, last: last(rays) }
    }
}

/// Number of rays of the last packet.
fn last(rays: &[Ray]) -> usize {
    rays.len() - rays.len().saturating_sub(1) / 16 * 16
}

fn packet(rays: &[Ray]) -> RTCRayHit16 {
    let mut packet = RTCRayHit16::default();
    for (lane, ray) in rays.iter().enumerate() {
        packet.ray.org_x[lane] = ray.origin.x;
        packet.ray.org_y[lane] = ray.origin.y;
        packet.ray.org_z[lane] = ray.origin.z;
        packet.ray.tnear[lane] = ray.t_near;
        packet.ray.dir_x[lane] = ray.direction.x;
        packet.ray.dir_y[lane] = ray.direction.y;
        packet.ray.dir_z[lane] = ray.direction.z;
        packet.ray.tfar[lane] = ray.t_far;
    }
    packet.ray.mask = [!0; 16];
    packet.hit.geomID = [RTC_INVALID_ID; 16];
    packet.hit.instID[0] = [RTC_INVALID_ID; 16];
    packet
}
