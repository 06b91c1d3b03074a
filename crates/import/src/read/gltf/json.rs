//! The JSON of a glTF file, without materials: the members that are read. Indices and values are
//! checked where they are used.
//!
//! The crate `gltf` is not used for it. Its validation panics on some indices out of range, and
//! refuses files that the standard allows (accessors without data, attributes of the application's
//! own).

use super::json_material::{ImageJson, MaterialJson, Sampler, TextureJson};
use super::malformed;
use bdpm_core::base::error::Result;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_4;
use std::fmt::Display;

/// Defines JSON objects whose members are all optional. A member without a default value gets that
/// of its type.
macro_rules! json_objects {
    (@default) => { Default::default() };
    (@default $default:expr) => { $default };
    ($($(#[$doc:meta])* struct $name:ident {
        $($(#[$attribute:meta])* $member:ident: $type:ty $(= $default:expr)?,)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(default, rename_all = "camelCase")]
        pub(super) struct $name { $($(#[$attribute])* pub $member: $type,)* }

        impl Default for $name {
            fn default() -> Self {
                Self { $($member: json_objects!(@default $($default)?),)* }
            }
        }
    )*};
}

/// Defines JSON objects with required members.
macro_rules! json_records {
    ($($(#[$doc:meta])* struct $name:ident {
        $($(#[$attribute:meta])* $member:ident: $type:ty,)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(rename_all = "camelCase")]
        pub(super) struct $name { $($(#[$attribute])* pub $member: $type,)* }
    )*};
}
pub(super) use {json_objects, json_records};

json_objects! {
    /// The top level.
    struct GltfDocument {
        asset: Asset,
        extensions_used: Vec<String>,
        extensions_required: Vec<String>,
        scene: Option<usize>,
        scenes: Vec<SceneJson>,
        nodes: Vec<Node>,
        meshes: Vec<MeshJson>,
        skins: Vec<Skin>,
        accessors: Vec<Accessor>,
        buffer_views: Vec<BufferView>,
        buffers: Vec<Buffer>,
        materials: Vec<MaterialJson>,
        textures: Vec<TextureJson>,
        samplers: Vec<Sampler>,
        images: Vec<ImageJson>,
        cameras: Vec<CameraJson>,
        animations: Vec<Unread>,
        extensions: DocumentExtensions,
    }

    struct Asset {
        version: String,
        min_version: Option<String>,
    }

    struct SceneJson {
        nodes: Vec<usize>,
    }

    struct Node {
        name: String,
        children: Vec<usize>,
        /// Column by column.
        matrix: Option<Box<[f64; 16]>>,
        translation: Option<[f64; 3]>,
        /// A quaternion, its real part last.
        rotation: Option<[f64; 4]>,
        scale: Option<[f64; 3]>,
        mesh: Option<usize>,
        skin: Option<usize>,
        /// Weights of the mesh's morph targets, in place of the mesh's own.
        weights: Option<Vec<f32>>,
        camera: Option<usize>,
        extensions: NodeExtensions,
    }

    struct NodeExtensions {
        #[serde(rename = "KHR_lights_punctual")]
        light: Option<NodeLight>,
        #[serde(rename = "EXT_lights_ies")]
        luminaire: Option<NodeLuminaire>,
        #[serde(rename = "EXT_mesh_gpu_instancing")]
        instancing: Option<GpuInstancing>,
        #[serde(rename = "KHR_node_visibility")]
        visibility: NodeVisibility,
    }

    /// Whether the meshes and lights of a node and of those below it are part of the image.
    struct NodeVisibility {
        visible: bool = true,
    }

    /// Many placements of one mesh: accessors by `TRANSLATION`, `ROTATION` and `SCALE`.
    struct GpuInstancing {
        attributes: BTreeMap<String, usize>,
    }

    struct DocumentExtensions {
        #[serde(rename = "KHR_lights_punctual")]
        punctual: PunctualLights,
        #[serde(rename = "EXT_lights_ies")]
        ies: IesProfiles,
    }

    struct IesProfiles {
        lights: Vec<IesProfile>,
    }

    /// An IES file.
    struct IesProfile {
        name: String,
        uri: Option<String>,
        buffer_view: Option<usize>,
    }

    struct PunctualLights {
        lights: Vec<PunctualLight>,
    }

    struct PunctualLight {
        name: String,
        #[serde(rename = "type")]
        kind: String,
        color: [f32; 3] = [1.0; 3],
        /// Candela, or lux if directional.
        intensity: f32 = 1.0,
        spot: SpotCone,
    }

    struct SpotCone {
        /// Radians from the axis.
        inner_cone_angle: f32,
        outer_cone_angle: f32 = FRAC_PI_4,
    }

    struct CameraJson {
        name: String,
        #[serde(rename = "type")]
        kind: String,
        perspective: Option<Perspective>,
        orthographic: Option<Orthographic>,
    }

    struct Orthographic {
        /// Halves of the width and of the height. They are required: NaN is refused.
        xmag: f32 = f32::NAN,
        ymag: f32 = f32::NAN,
    }

    struct Perspective {
        /// Width over height.
        aspect_ratio: Option<f32>,
        /// Radians across the height. It is required: NaN is refused.
        yfov: f32 = f32::NAN,
    }

    struct MeshJson {
        name: String,
        primitives: Vec<Primitive>,
        /// Weights of the morph targets of each primitive.
        weights: Vec<f32>,
    }

    /// Joints that move a mesh.
    struct Skin {
        inverse_bind_matrices: Option<usize>,
        /// Nodes.
        joints: Vec<usize>,
    }

    struct Primitive {
        /// Accessors by semantic.
        attributes: BTreeMap<String, usize>,
        indices: Option<usize>,
        material: Option<usize>,
        mode: u64 = 4,
        /// Morph targets: accessors by semantic, added to the attributes times a weight.
        targets: Vec<BTreeMap<String, usize>>,
        extensions: PrimitiveExtensions,
    }

    struct PrimitiveExtensions {
        #[serde(rename = "KHR_draco_mesh_compression")]
        draco: Option<Unread>,
    }

    struct ViewExtensions {
        #[serde(rename = "EXT_meshopt_compression")]
        ext_meshopt: Option<MeshoptView>,
        #[serde(rename = "KHR_meshopt_compression")]
        khr_meshopt: Option<MeshoptView>,
    }

    struct BufferExtensions {
        #[serde(rename = "EXT_meshopt_compression")]
        ext_meshopt: MeshoptBuffer,
        #[serde(rename = "KHR_meshopt_compression")]
        khr_meshopt: MeshoptBuffer,
    }

    /// Whether a buffer is for readers without the extension only.
    struct MeshoptBuffer {
        fallback: bool,
    }
}

json_records! {
    /// An object without members that are read.
    struct Unread {}

    struct NodeLight {
        light: usize,
    }

    /// An instance of an IES file.
    struct NodeLuminaire {
        light: usize,
        multiplier: Option<f32>,
        color: Option<[f32; 3]>,
    }

    struct Accessor {
        buffer_view: Option<usize>,
        #[serde(default)]
        byte_offset: u64,
        component_type: u64,
        #[serde(default)]
        normalized: bool,
        count: u64,
        #[serde(rename = "type")]
        kind: String,
        sparse: Option<Sparse>,
    }

    struct Sparse {
        count: u64,
        indices: SparseIndices,
        values: SparseValues,
    }

    struct SparseIndices {
        buffer_view: usize,
        #[serde(default)]
        byte_offset: u64,
        component_type: u64,
    }

    struct SparseValues {
        buffer_view: usize,
        #[serde(default)]
        byte_offset: u64,
    }

    struct BufferView {
        buffer: usize,
        #[serde(default)]
        byte_offset: u64,
        byte_length: u64,
        byte_stride: Option<u64>,
        #[serde(default)]
        extensions: ViewExtensions,
    }

    struct Buffer {
        uri: Option<String>,
        byte_length: u64,
        #[serde(default)]
        extensions: BufferExtensions,
    }

    /// A view in compressed form.
    struct MeshoptView {
        buffer: usize,
        #[serde(default)]
        byte_offset: u64,
        byte_length: u64,
        byte_stride: u64,
        count: u64,
        mode: String,
        filter: Option<String>,
    }
}

impl ViewExtensions {
    /// The compressed form, if the view has one.
    pub fn meshopt(&self) -> Option<&MeshoptView> {
        self.khr_meshopt.as_ref().or(self.ext_meshopt.as_ref())
    }

    /// Name of the extension of [`Self::meshopt`].
    pub fn meshopt_name(&self) -> &'static str {
        match self.khr_meshopt {
            Some(_) => "KHR_meshopt_compression",
            None => "EXT_meshopt_compression",
        }
    }
}

impl BufferExtensions {
    pub fn all(&self) -> impl Iterator<Item = &MeshoptBuffer> {
        [&self.ext_meshopt, &self.khr_meshopt].into_iter()
    }
}

/// The item `name[index]` of a list, which `element` refers to.
pub(super) fn get<'a, T>(
    list: &'a [T],
    name: &str,
    index: usize,
    element: impl Display,
) -> Result<&'a T> {
    list.get(index).ok_or_else(|| {
        malformed(element, format!("there is no {name}[{index}]; the file has {}", list.len()))
    })
}
