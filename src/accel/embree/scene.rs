//! Scenes: built once, then immutable.

use super::instance::Shared;
use super::packets;
use super::packets::PacketSize;
use super::{Device, EmbreeError};
use crate::accel::{
    AccelInfo, Coherence, Geometry, Hit, HitPacket, Intersect, Ray, RayPacket, TriangleMesh,
};
use crate::lanes::Mask;
use embree4_sys as sys;
use std::time::{Duration, Instant};

/// Names a mesh of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GeomId(pub(super) u32);

impl GeomId {
    /// The number that [`Hit::mesh`] holds: meshes, and places of shared ones, count from 0 in the
    /// order of adding.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// An owned reference to an Embree scene.
#[derive(Debug)]
pub(super) struct SceneHandle(pub(super) sys::RTCScene);

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: came from `rtcNewScene`; released once, here.
        unsafe { sys::rtcReleaseScene(self.0) };
    }
}

/// An owned reference to an Embree geometry; a scene that it is attached to holds its own.
pub(super) struct GeometryHandle(pub(super) sys::RTCGeometry);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: came from `rtcNewGeometry`; released once, here.
        unsafe { sys::rtcReleaseGeometry(self.0) };
    }
}

/// A scene that still takes meshes. It may move between threads but not be shared by them.
#[derive(Debug)]
pub struct SceneBuilder {
    // Dropped in this order: the scene's handle before the device's.
    pub(super) handle: SceneHandle,
    /// Meshes and places of shared ones.
    pub(super) meshes: u32,
    pub(super) shared: Vec<Shared>,
    pub(super) watertight: bool,
    triangles: usize,
    /// What the device held before this scene.
    bytes_before: usize,
    pub(super) device: Device,
}

// SAFETY: Embree ties scenes and geometries to no thread; it only forbids changing one from two
// threads at once, which `&mut self` on every method rules out. `SceneBuilder` is not `Sync`.
unsafe impl Send for SceneBuilder {}

impl SceneBuilder {
    pub(super) fn new(device: &Device) -> Result<Self, EmbreeError> {
        let bytes_before = device.bytes();
        let handle = device.checked("make a scene", || {
            // SAFETY: the device handle is valid as long as `device`.
            SceneHandle(unsafe { sys::rtcNewScene(device.handle()) })
        })?;
        let scene = Self {
            handle,
            meshes: 0,
            shared: Vec::new(),
            watertight: false,
            triangles: 0,
            bytes_before,
            device: device.clone(),
        };
        let quality = sys::RTCBuildQuality::RTC_BUILD_QUALITY_HIGH;
        device.checked("set the scene's build quality", || {
            // SAFETY: the scene handle is valid and used by this thread only.
            unsafe { sys::rtcSetSceneBuildQuality(scene.handle.0, quality) };
        })?;
        Ok(scene)
    }

    /// Turns Embree's robust mode on or off; off to begin with.
    ///
    /// Without it about one ray in a million slips through between two triangles of a closed mesh
    /// (measured: 11 of 8 million on 217,000 triangles, none of 33 million in a box of 36), more
    /// if rays are aimed right at edges. With it practically none does, for about 1.5 times the
    /// tracing time: choose it where a dim room must keep out a light that is a million times as
    /// bright.
    ///
    /// # Errors
    /// If Embree refuses.
    pub fn set_watertight(&mut self, on: bool) -> Result<(), EmbreeError> {
        let flags = if on {
            sys::RTCSceneFlags::RTC_SCENE_FLAG_ROBUST
        } else {
            sys::RTCSceneFlags::RTC_SCENE_FLAG_NONE
        };
        self.device.checked("set the scene's flags", || {
            // SAFETY: the scene handle is valid and `&mut self` means that nobody else uses it.
            unsafe { sys::rtcSetSceneFlags(self.handle.0, flags) };
        })?;
        self.watertight = on;
        self.shared.iter_mut().try_for_each(|shared| shared.scene.set_watertight(on))
    }

    /// Copies a mesh into the scene. An empty one takes an id too.
    ///
    /// # Errors
    /// [`EmbreeError::Mesh`] if [`TriangleMesh::validate`] refuses it; [`EmbreeError::Library`] if
    /// Embree does, as when memory runs out. The scene is then as it was before.
    pub fn add_mesh(&mut self, mesh: TriangleMesh<'_>) -> Result<GeomId, EmbreeError> {
        let id = self.meshes;
        mesh.validate().map_err(|problem| EmbreeError::Mesh { mesh: id, problem })?;
        if !mesh.triangles.is_empty() {
            self.attach(mesh, id)?;
        }
        self.meshes += 1;
        self.triangles += mesh.triangles.len();
        Ok(GeomId(id))
    }

    fn attach(&mut self, mesh: TriangleMesh<'_>, id: u32) -> Result<(), EmbreeError> {
        let device = &self.device;
        let geometry = device.checked("make a geometry", || {
            let kind = sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE;
            // SAFETY: the device handle is valid as long as `device`.
            GeometryHandle(unsafe { sys::rtcNewGeometry(device.handle(), kind) })
        })?;
        let (vertex, float3) =
            (sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX, sys::RTCFormat::RTC_FORMAT_FLOAT3);
        let (index, uint3) =
            (sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX, sys::RTCFormat::RTC_FORMAT_UINT3);
        self.copy(&geometry, vertex, float3, mesh.positions)?;
        self.copy(&geometry, index, uint3, mesh.triangles)?;
        device.checked("add a mesh", || {
            // SAFETY: both handles are valid and used by this thread only. All indices were
            // checked against the vertex count, and no geometry has this id yet.
            unsafe {
                sys::rtcCommitGeometry(geometry.0);
                sys::rtcAttachGeometryByID(self.handle.0, geometry.0, id);
            }
        })
    }

    /// Copies `items` into a new buffer of Embree's, which pads it for its own wide reads.
    fn copy<T: Copy>(
        &self,
        geometry: &GeometryHandle,
        kind: sys::RTCBufferType,
        format: sys::RTCFormat,
        items: &[T],
    ) -> Result<(), EmbreeError> {
        let buffer = self.device.checked("allocate a mesh", || {
            // SAFETY: the geometry is valid; stride and count describe a buffer that Embree makes.
            unsafe {
                sys::rtcSetNewGeometryBuffer(
                    geometry.0,
                    kind,
                    0,
                    format,
                    size_of::<T>(),
                    items.len(),
                )
            }
        })?;
        if buffer.is_null() {
            return Err(EmbreeError::Library {
                doing: "allocate a mesh",
                code: "no error code",
                message: "no memory was returned".into(),
            });
        }
        // SAFETY: the buffer is new, so nothing overlaps, and holds `len` strides of `T`'s size,
        // aligned to at least 4 as `T` (`Vec3` or `[u32; 3]`) is. Copying bytes needs no more.
        unsafe { std::ptr::copy_nonoverlapping(items.as_ptr(), buffer.cast::<T>(), items.len()) };
        Ok(())
    }

    /// Builds the acceleration structure, on all of the device's threads.
    ///
    /// # Errors
    /// If Embree cannot, as when memory runs out.
    pub fn commit(mut self) -> Result<CommittedScene, EmbreeError> {
        let start = Instant::now();
        for Shared { scene, .. } in std::mem::take(&mut self.shared) {
            // Its places hold what Embree needs of it.
            self.triangles += scene.commit()?.triangles;
        }
        self.device.checked("build the scene", || {
            // SAFETY: the scene handle is valid, and `self` by value means that nobody else uses it.
            unsafe { sys::rtcCommitScene(self.handle.0) };
        })?;
        let build_time = start.elapsed();
        let bytes = self.device.bytes().saturating_sub(self.bytes_before);
        let packet_size = PacketSize::of(&self.device);
        let Self { handle, triangles, device, .. } = self;
        Ok(CommittedScene { handle, packet_size, triangles, bytes, build_time, device })
    }
}

/// An immutable scene that answers ray queries, from any number of threads at once.
///
/// It keeps the device alive. Rays should be finite; one that is not gives some answer, no fault.
#[derive(Debug)]
pub struct CommittedScene {
    // Dropped in this order: the scene's handle before the device's.
    handle: SceneHandle,
    packet_size: PacketSize,
    triangles: usize,
    bytes: usize,
    build_time: Duration,
    device: Device,
}

// SAFETY: no method changes the scene after `commit`. Embree allows any number of threads to query
// a committed scene at once, and its reference counts are atomic, so any thread may drop it.
unsafe impl Send for CommittedScene {}
// SAFETY: as above; `&self` gives access to queries only.
unsafe impl Sync for CommittedScene {}

impl CommittedScene {
    /// Builds a scene of these meshes; their indices are those in the slice.
    ///
    /// # Errors
    /// As [`SceneBuilder::add_mesh`] and [`SceneBuilder::commit`].
    pub fn from_meshes(device: &Device, meshes: &[TriangleMesh<'_>]) -> Result<Self, EmbreeError> {
        Self::new(device, &Geometry::of_meshes(meshes))
    }

    /// Builds a scene of meshes at their places; the indices are those of the places.
    ///
    /// # Errors
    /// As [`SceneBuilder::add`] and [`SceneBuilder::commit`].
    pub fn new(device: &Device, geometry: &Geometry<'_>) -> Result<Self, EmbreeError> {
        let mut builder = device.scene_builder()?;
        builder.add(geometry)?;
        builder.commit()
    }
}

impl Intersect for CommittedScene {
    fn intersect(
        &self,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
        coherence: Coherence,
    ) {
        assert_eq!(rays.len(), hits.len(), "one packet of hits per packet of rays");
        let (scene, size) = (self.handle.0, self.packet_size);
        // SAFETY: a `CommittedScene`'s handle is committed, never changes, and lives as long as it.
        unsafe { packets::intersect(scene, size, (rays, count), hits, coherence) };
    }

    fn occlude(
        &self,
        rays: &[RayPacket],
        count: usize,
        occluded: &mut [Mask],
        coherence: Coherence,
    ) {
        assert_eq!(rays.len(), occluded.len(), "one packet of answers per packet of rays");
        let (scene, size) = (self.handle.0, self.packet_size);
        // SAFETY: as in `intersect`.
        unsafe { packets::occlude(scene, size, (rays, count), occluded, coherence) };
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        // SAFETY: as in `intersect`.
        unsafe { packets::closest_hit(self.handle.0, ray) }
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        // SAFETY: as in `intersect`.
        unsafe { packets::is_occluded(self.handle.0, ray) }
    }

    /// `bytes` is Embree's own count for the device, before and after; scenes that other threads
    /// build on the same device meanwhile would be counted in.
    fn describe(&self) -> AccelInfo {
        // Embree tells its version but not its instruction set; the widest packet that it traces as
        // one says which family it chose.
        let isa = match self.device.native_packet_size() {
            16 => "AVX-512",
            8 => "AVX or AVX2",
            _ => "SSE",
        };
        AccelInfo {
            name: format!("Embree {}, {isa}", self.device.version()),
            packet_size: self.packet_size.rays(),
            triangles: self.triangles,
            bytes: self.bytes,
            build_time: self.build_time,
        }
    }
}
