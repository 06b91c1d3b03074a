//! Scenes: built once, then immutable.

use super::geometry::GeometryHandle;
use super::instance::{PendingInstance, SharedMeshes};
use super::packets::{self, PacketSize};
use super::{Device, EmbreeError, single};
use crate::lanes::Mask;
use crate::{
    AccelInfo, Coherence, Geometry, Hit, HitPacket, Intersect, Ray, RayPacket, TriangleMesh,
};
use embree4_sys as sys;
use std::ptr::NonNull;
use std::time::{Duration, Instant};

/// Names a mesh of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GeomId(pub(super) u32);

impl GeomId {
    /// The number in [`Hit::mesh`]: meshes, and instances of shared ones, count from 0 in the order
    /// of adding.
    pub const fn index(self) -> u32 {
        self.0
    }
}

/// An owned reference to an Embree scene.
#[derive(Debug)]
pub(super) struct SceneHandle(NonNull<sys::RTCSceneTy>);

impl SceneHandle {
    pub(super) fn get(&self) -> sys::RTCScene {
        self.0.as_ptr()
    }
}

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: came from `rtcNewScene`; released once, here.
        unsafe { sys::rtcReleaseScene(self.get()) };
    }
}

/// A scene that still accepts meshes. It may move between threads but not be shared by them.
#[derive(Debug)]
pub struct SceneBuilder {
    // Dropped in this order: the scene's handle before the device's.
    pub(super) handle: SceneHandle,
    /// Number of meshes and of instances of shared ones.
    pub(super) meshes: u32,
    pub(super) shared: Vec<SharedMeshes>,
    pub(super) pending: Vec<PendingInstance>,
    pub(super) watertight: bool,
    pub(super) triangles: usize,
    /// Bytes of the device before this scene.
    bytes_before: usize,
    pub(super) device: Device,
}

// SAFETY: Embree ties scenes and geometries to no thread; it only forbids changing one from two
// threads at once, which `&mut self` on every method rules out. `SceneBuilder` is not `Sync`.
unsafe impl Send for SceneBuilder {}

impl SceneBuilder {
    pub(super) fn new(device: &Device) -> Result<Self, EmbreeError> {
        let bytes_before = device.bytes();
        let handle = SceneHandle(device.made("make a scene", || {
            // SAFETY: the device handle is valid as long as `device`.
            unsafe { sys::rtcNewScene(device.handle()) }
        })?);
        let scene = Self {
            handle,
            meshes: 0,
            shared: Vec::new(),
            pending: Vec::new(),
            watertight: false,
            triangles: 0,
            bytes_before,
            device: device.clone(),
        };
        let quality = sys::RTCBuildQuality::RTC_BUILD_QUALITY_HIGH;
        device.checked("set the scene's build quality", || {
            // SAFETY: the scene handle is valid and used by this thread only.
            unsafe { sys::rtcSetSceneBuildQuality(scene.handle.get(), quality) };
        })?;
        Ok(scene)
    }

    /// Turns Embree's robust mode on or off; the default is off.
    ///
    /// Without it about one ray in a million passes between two triangles of a closed mesh, more if
    /// rays aim at edges. Measured: 11 of 8 million on 217,000 triangles, none of 33 million in a
    /// box of 36. With it practically no ray does, for about 1.5 times the tracing time. Choose it
    /// if a dim room must keep out a light that is a million times as bright.
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
            unsafe { sys::rtcSetSceneFlags(self.handle.get(), flags) };
        })?;
        self.watertight = on;
        self.shared.iter_mut().try_for_each(|shared| shared.scene.set_watertight(on))
    }

    /// Copies a mesh into the scene. An empty mesh takes an id too.
    ///
    /// # Errors
    /// [`EmbreeError::Mesh`] if [`TriangleMesh::validate`] refuses it;
    /// [`EmbreeError::TooManyMeshes`] if there is no id left; [`EmbreeError::Library`] if Embree
    /// refuses, as when memory runs out. The scene is then unchanged.
    pub fn add_mesh(&mut self, mesh: TriangleMesh<'_>) -> Result<GeomId, EmbreeError> {
        let id = self.meshes;
        let meshes = self.meshes_with(1)?;
        if let Some(geometry) = GeometryHandle::of_mesh(&self.device, mesh, id)? {
            self.attach(&geometry, id)?;
        }
        self.meshes = meshes;
        self.triangles += mesh.triangles.len();
        Ok(GeomId(id))
    }

    /// The number of meshes plus `more`. The largest id stays below the one that means "nothing".
    pub(super) fn meshes_with(&self, more: u32) -> Result<u32, EmbreeError> {
        self.meshes.checked_add(more).ok_or(EmbreeError::TooManyMeshes)
    }

    /// Attaches `geometry`, which must be of the same device, to this scene.
    pub(super) fn attach(&mut self, geometry: &GeometryHandle, id: u32) -> Result<(), EmbreeError> {
        self.device.checked("add a geometry to the scene", || {
            // SAFETY: both handles are valid, and `&mut self` means that nobody else uses the
            // scene. Embree refuses a geometry of another device and an id that is taken.
            unsafe { sys::rtcAttachGeometryByID(self.handle.get(), geometry.get(), id) };
        })
    }

    /// Builds the acceleration structure, on all of the device's threads.
    ///
    /// # Errors
    /// If Embree cannot, as when memory runs out.
    pub fn commit(mut self) -> Result<CommittedScene, EmbreeError> {
        let start = Instant::now();
        self.commit_instances()?;
        self.device.checked("build the scene", || {
            // SAFETY: the scene handle is valid, and `self` by value means that nobody else uses
            // it.
            unsafe { sys::rtcCommitScene(self.handle.get()) };
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
/// It keeps the device alive. Origins and directions should be finite. A ray that is not finite
/// gets an arbitrary result without a fault. In a coherent batch its neighbors may get one too,
/// because Embree bounds them together.
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

    /// Builds a scene of instances, whose indices the hits have.
    ///
    /// # Errors
    /// As [`SceneBuilder::add`] and [`SceneBuilder::commit`].
    ///
    /// # Panics
    /// If an instance names a mesh that does not exist.
    pub fn new(device: &Device, geometry: &Geometry<'_>) -> Result<Self, EmbreeError> {
        let mut builder = device.scene_builder()?;
        builder.add(geometry)?;
        builder.commit()
    }

    /// Committed, never changed, and valid as long as `self`.
    pub(super) fn handle(&self) -> sys::RTCScene {
        self.handle.get()
    }

    pub(super) fn triangles(&self) -> usize {
        self.triangles
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
        let (scene, size) = (self.handle(), self.packet_size);
        // SAFETY: the scene is committed, never changes, and lives as long as `self`.
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
        let (scene, size) = (self.handle(), self.packet_size);
        // SAFETY: as in `intersect`.
        unsafe { packets::occlude(scene, size, (rays, count), occluded, coherence) };
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        // SAFETY: as in `intersect`.
        unsafe { single::closest_hit(self.handle(), ray) }
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        // SAFETY: as in `intersect`.
        unsafe { single::is_occluded(self.handle(), ray) }
    }

    /// `bytes` is the growth of Embree's own count for the device: it includes scenes that other
    /// threads build on the device at the same time.
    fn describe(&self) -> AccelInfo {
        // Embree reports its version but not its instruction set; the widest packet that it traces
        // as one shows the family.
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, Vec3};

    /// The last id is one below that of a miss, and a call without an id left changes nothing.
    #[test]
    fn meshes_after_the_last_id_are_refused() {
        let nothing = TriangleMesh { positions: &[], triangles: &[] };
        let corner = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let triangle = TriangleMesh { positions: &corner, triangles: &[[0, 1, 2]] };
        let mut builder = Device::new().unwrap().scene_builder().unwrap();
        let first = builder.add_mesh(triangle).unwrap();
        let two = builder.share(&[nothing, triangle]).unwrap();
        builder.meshes = u32::MAX - 1; // as if as many without triangles had been added
        let placed = builder.place(two, DAffine3::IDENTITY);
        assert_eq!(placed, Err(EmbreeError::TooManyMeshes));
        assert_eq!(builder.add_mesh(nothing).map(GeomId::index), Ok(u32::MAX - 1));
        for mesh in [nothing, triangle] {
            assert_eq!(builder.add_mesh(mesh), Err(EmbreeError::TooManyMeshes));
        }
        let scene = builder.commit().unwrap();
        assert_eq!(scene.triangles, 2);
        let ray = Ray::new(Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);
        assert_eq!(scene.closest_hit(&ray).mesh, first.index());
    }
}
