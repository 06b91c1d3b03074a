//! Geometries of scenes, complete and committed when they are attached.

use super::scene::CommittedScene;
use super::{Device, EmbreeError};
use crate::TriangleMesh;
use bytemuck::Pod;
use embree4_sys as sys;
use glam::{Affine3A, Vec3};
use std::ffi::c_void;
use std::ptr::NonNull;

/// An owned reference to an Embree geometry; a scene that it is attached to holds its own.
pub(super) struct GeometryHandle(NonNull<sys::RTCGeometryTy>);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: came from `rtcNewGeometry`; released once, here.
        unsafe { sys::rtcReleaseGeometry(self.get()) };
    }
}

/// Element type of an Embree buffer.
trait Element: Pod {
    const BUFFER: sys::RTCBufferType;
    /// Format of the size of `Self`, which is the stride.
    const FORMAT: sys::RTCFormat;
}

impl Element for Vec3 {
    const BUFFER: sys::RTCBufferType = sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX;
    const FORMAT: sys::RTCFormat = sys::RTCFormat::RTC_FORMAT_FLOAT3;
}

impl Element for [u32; 3] {
    const BUFFER: sys::RTCBufferType = sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX;
    const FORMAT: sys::RTCFormat = sys::RTCFormat::RTC_FORMAT_UINT3;
}

impl GeometryHandle {
    /// A copy of a mesh; `None` if it has no triangles.
    ///
    /// # Errors
    /// [`EmbreeError::Mesh`] with `id` if [`TriangleMesh::validate`] refuses it, or an error of
    /// Embree.
    pub(super) fn of_mesh(
        device: &Device,
        mesh: TriangleMesh<'_>,
        id: u32,
    ) -> Result<Option<Self>, EmbreeError> {
        mesh.validate().map_err(|problem| EmbreeError::Mesh { mesh: id, problem })?;
        if mesh.triangles.is_empty() {
            return Ok(None);
        }
        let geometry = Self::new(device, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        // Embree checks no index; they are in range, as the mesh is valid.
        geometry.copy(device, mesh.positions)?;
        geometry.copy(device, mesh.triangles)?;
        geometry.commit(device)?;
        Ok(Some(geometry))
    }

    /// An instance of `scene`, which must not hold instances itself: Embree has one level of them.
    pub(super) fn instance(
        device: &Device,
        scene: &CommittedScene,
        to_scene: &Affine3A,
    ) -> Result<Self, EmbreeError> {
        let instance = Self::new(device, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_INSTANCE)?;
        device.checked("set the scene of an instance", || {
            // SAFETY: both handles are valid, and the instance is used by this thread only. Embree
            // counts its reference to the scene.
            unsafe { sys::rtcSetGeometryInstancedScene(instance.get(), scene.handle()) };
        })?;
        let (format, columns) =
            (sys::RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, to_scene.to_cols_array());
        device.checked("set the transform of an instance", || {
            // SAFETY: the instance as above; the format is twelve numbers, and Embree copies them.
            unsafe {
                sys::rtcSetGeometryTransform(instance.get(), 0, format, columns.as_ptr().cast());
            }
        })?;
        instance.commit(device)?;
        Ok(instance)
    }

    pub(super) fn get(&self) -> sys::RTCGeometry {
        self.0.as_ptr()
    }

    fn new(device: &Device, kind: sys::RTCGeometryType) -> Result<Self, EmbreeError> {
        let handle = device.made("make a geometry", || {
            // SAFETY: the device handle is valid as long as `device`.
            unsafe { sys::rtcNewGeometry(device.handle(), kind) }
        })?;
        Ok(Self(handle))
    }

    /// Copies `elements` into a new buffer of Embree's, which pads it for its own wide reads.
    fn copy<T: Element>(&self, device: &Device, elements: &[T]) -> Result<(), EmbreeError> {
        const { assert!(size_of::<T>() == 12, "both formats are three words of 4 bytes") };
        let (stride, count) = (size_of::<T>(), elements.len());
        let buffer = device.made("allocate a mesh", || -> *mut c_void {
            // SAFETY: the geometry is valid and used by this thread only; the stride is the
            // format's size, and Embree refuses more elements than it can number.
            unsafe {
                sys::rtcSetNewGeometryBuffer(self.get(), T::BUFFER, 0, T::FORMAT, stride, count)
            }
        })?;
        let bytes: &[u8] = bytemuck::cast_slice(elements);
        // SAFETY: the buffer is new, so nothing overlaps, and holds `count` strides of the
        // elements' size, so all their bytes.
        unsafe {
            buffer.cast::<u8>().as_ptr().copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        }
        Ok(())
    }

    fn commit(&self, device: &Device) -> Result<(), EmbreeError> {
        device.checked("commit a geometry", || {
            // SAFETY: the handle is valid and used by this thread only.
            unsafe { sys::rtcCommitGeometry(self.get()) };
        })
    }
}
