//! The merge kernel: which photons count at a point, and by what area their flux is divided.

use super::area::{Areas, Domain, PointAreas, Query, admission};
use super::gather::GatherPacket;
use super::photon::{Photon, PhotonClass, PhotonSide};
use super::photon_map::MergeQuery;
use crate::base::math::{Rgb, disc_area};
use crate::base::spectrum::{Neighbors, Wavelength};
use crate::scene::diffuse::TriangleSide;
use crate::settings::{self, Settings};
use crate::simd::{LANES, Mask, Vec3s};
use glam::Vec3;
use std::array::from_fn;
use std::f32::consts::FRAC_1_SQRT_2;

/// A value for photons of either class, by [`PhotonClass`].
pub type ByClass<T> = [T; 2];

const CAUSTIC: usize = PhotonClass::Caustic as usize;
const DIFFUSE: usize = PhotonClass::Diffuse as usize;

/// Decides which photons count at a point: those within the radius of their class, on a surface
/// whose normal is nearly the point's and whose plane is near the point. Those on the other side of
/// the point's surface do not count. theory.md (45b).
#[derive(Clone, Copy, Debug)]
pub struct Admission {
    /// Squares of the merge radii, scene units squared.
    pub radius2: ByClass<f32>,
    /// Squares of the nested radii, in the order of theory.md (68).
    pub nested2: [ByClass<f32>; 2],
    /// Lower bound of the dot product of the point's normal with the photon's, which is 127 units
    /// long.
    pub limit: f32,
    /// Factor of the squared offset along the photon's normal, 127 units long: the product must be
    /// within the squared radius, too.
    pub flattening: f32,
    /// Sums the classes separately even where both count within the same radius.
    pub separate_classes: bool,
}

impl Admission {
    /// Square of the smallest radius within which a photon at the squared distance `distance2` from
    /// `position` may count there.
    #[inline]
    pub fn min_radius2(&self, photon: &Photon, distance2: f32, position: Vec3) -> f32 {
        let offset = photon.cosine(photon.position - position);
        distance2.max(self.flattening * offset * offset)
    }

    /// Tests whether a photon of this [`Self::min_radius2`] counts in a query.
    #[inline]
    pub fn admits(&self, photon: &Photon, min_radius2: f32, query: &MergeQuery) -> bool {
        min_radius2 <= self.radius2[photon.class() as usize]
            && photon.cosine(query.normal) > self.limit
            && query.admits_side(photon.arrival)
    }

    /// Tests whether photons of both classes are added to one sum, having the same radius.
    pub fn is_uniform(&self) -> bool {
        !self.separate_classes && self.radius2[CAUSTIC] == self.radius2[DIFFUSE]
    }

    /// Admits photons within the radii of a domain.
    #[must_use]
    pub fn within(self, domain: Domain) -> Self {
        let scale = 0.25f32.powi(domain.level().into());
        let smaller = |radius2: ByClass<f32>| radius2.map(|radius2| scale * radius2);
        let (radius2, nested2) = (smaller(self.radius2), self.nested2.map(smaller));
        Self { radius2, nested2, ..self }
    }

    /// Index of the sum to which the flux of a photon class is added.
    pub fn sum_of(&self, class: PhotonClass) -> usize {
        if self.is_uniform() { DIFFUSE } else { class as usize }
    }
}

/// A constant kernel for either class of photons: theory.md (45).
#[derive(Clone, Copy)]
pub struct MergeKernel<'a> {
    /// Merge radii, scene units.
    radii: ByClass<f32>,
    /// Surfaces that could have sent the photons; without them the kernel is a disc.
    areas: Option<&'a Areas>,
    /// Photon classes with nested radii. For a class without them the nested radii equal the merge
    /// radius.
    nests: ByClass<bool>,
    /// Wavelengths that merge, where photons and camera paths have one.
    pub(super) wavelengths: WavelengthKernel,
}

/// A constant kernel over the wavelengths of photons, for camera paths that have a wavelength:
/// theory.md (47l).
#[derive(Clone, Copy, Debug)]
pub(super) struct WavelengthKernel {
    /// Share of the spectrum within which wavelengths merge.
    width: f64,
    /// The width at the nested radii, in the order of theory.md (68).
    nested: [f64; 2],
}

/// The kernel over wavelengths around that of a camera path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathWavelengths {
    whole: Neighbors,
    nested: [Neighbors; 2],
}

/// Factors of the merge of a photon with a camera path by their wavelengths.
#[derive(Clone, Copy, Debug)]
pub(super) struct WavelengthFactors {
    /// Factor of the photon's flux.
    pub flux: Rgb,
    /// The kernels over wavelengths at the nested radii, over the kernel at the merge radii.
    pub nested: [f32; 2],
}

impl WavelengthFactors {
    /// Factors where the photon or the camera path stands for all wavelengths.
    pub const ALL: Self = Self { flux: Rgb::ONE, nested: [1.0; 2] };
}

impl WavelengthKernel {
    fn new(width: f64) -> Self {
        Self { width, nested: NESTED.map(|share| width * f64::from(share)) }
    }

    /// The kernel of the same width at the nested radii.
    fn without_nested(self) -> Self {
        Self { nested: [self.width; 2], ..self }
    }

    /// The kernel around a wavelength.
    pub fn around(&self, own: Wavelength) -> PathWavelengths {
        PathWavelengths {
            whole: own.neighbors(self.width),
            nested: self.nested.map(|width| own.neighbors(width)),
        }
    }
}

impl PathWavelengths {
    /// Factors of a photon; `None` if it does not merge.
    #[inline]
    pub fn factors(&self, photon: &Photon) -> Option<WavelengthFactors> {
        let Some(wavelength) = photon.wavelength() else { return Some(WavelengthFactors::ALL) };
        self.whole.contains(wavelength).then(|| WavelengthFactors {
            flux: self.whole.merge_factor(wavelength),
            nested: self.nested.map(|nested| {
                let inside = nested.contains(wavelength);
                if inside { self.whole.prob() / nested.prob() } else { 0.0 }
            }),
        })
    }
}

/// Nested radii over the merge radius.
pub(super) const NESTED: [f32; 2] = [FRAC_1_SQRT_2, 0.5];

/// Nested radii at which the kernel is computed beside the merge radii.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NestedRadii {
    None,
    /// Half the merge radii.
    Half,
    /// Half the merge radii, and `1/sqrt(2)` of them.
    Both,
}

/// The kernel at sixteen points.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointKernels {
    /// The photons that may count at each point.
    pub(super) domain: [Domain; LANES],
    inverse_area: [f32; LANES],
    caustic: [f32; LANES],
    nested: [ByClass<[f32; LANES]>; 2],
}

/// The kernel at one point.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointKernel {
    /// Reciprocal of the area for diffuse photons, 1/scene units squared.
    pub inverse_area: f32,
    /// The kernel for caustic photons over the kernel for diffuse photons.
    pub caustic: f32,
    /// The kernels at `1/sqrt(2)` and at half of the radii, over the kernels at the radii. Zero
    /// unless requested.
    pub nested: [ByClass<f32>; 2],
}

impl<'a> MergeKernel<'a> {
    /// The kernel of these settings, with the areas of the scene's surfaces for
    /// [`settings::Kernel::Area`].
    ///
    /// # Panics
    /// If the settings ask for areas and `areas` is `None`.
    pub fn new(settings: &Settings, areas: Option<&'a Areas>) -> Self {
        let wavelengths = WavelengthKernel::new(settings.wavelength_width);
        let discs = Self { wavelengths, ..Self::discs(settings.merge_radii()) };
        match settings.kernel {
            settings::Kernel::Disc => discs,
            settings::Kernel::Area => Self { areas: Some(areas.expect("areas")), ..discs },
        }
    }

    /// Restricts nested radii to one photon class, so that they measure the bias of that class
    /// only. The radii of the classes must differ.
    #[must_use]
    pub fn with_nested_class(self, class: PhotonClass) -> Self {
        let mut nests = [false; 2];
        nests[class as usize] = true;
        Self { nests, ..self.without_nested_width() }
    }

    /// The kernel whose nested radii are the radii themselves.
    #[must_use]
    pub fn without_nested_radii(self) -> Self {
        Self { nests: [false; 2], ..self.without_nested_width() }
    }

    /// The kernel whose width over wavelengths is the same at the nested radii.
    #[must_use]
    pub fn without_nested_width(self) -> Self {
        Self { wavelengths: self.wavelengths.without_nested(), ..self }
    }

    /// The kernel for diffuse photons as the kernel of all: for maps without caustic photons, where
    /// it takes one area less.
    #[must_use]
    pub fn without_caustics(self) -> Self {
        Self { radii: [self.radii[DIFFUSE]; 2], nests: [self.nests[DIFFUSE]; 2], ..self }
    }

    /// A disc of one radius for all photons.
    pub fn disc(radius: f32) -> Self {
        Self::discs([radius; 2])
    }

    /// Discs of these radii, with the built-in width of wavelengths.
    pub fn discs(radii: ByClass<f32>) -> Self {
        let wavelengths = WavelengthKernel::new(settings::DEFAULT_WAVELENGTH_WIDTH);
        Self { radii, areas: None, nests: [true; 2], wavelengths }
    }

    /// The larger merge radius, scene units: photons are looked up within it.
    pub fn reach(&self) -> f32 {
        self.radii[CAUSTIC].max(self.radii[DIFFUSE])
    }

    /// The merge radii, scene units.
    pub(super) fn radii(&self) -> ByClass<f32> {
        self.radii
    }

    /// Decides which photons count.
    pub fn admission(&self) -> Admission {
        // Photons on a disc count on the same side of the surface. True areas are those of surfaces
        // within 60 degrees and not far from their own planes.
        let (limit, flattening) = if self.areas.is_some() {
            (admission::LIMIT, admission::FLATTENING)
        } else {
            (0.0, 0.0)
        };
        let square = |radii: ByClass<f32>| radii.map(|radius| radius * radius);
        let nested2 = NESTED.map(|share| square(self.nested(share)));
        let radius2 = square(self.radii);
        Admission { radius2, nested2, limit, flattening, separate_classes: false }
    }

    /// The side whose photons do not count at a point on `facet`: the other side of the same
    /// surface.
    #[inline(always)] // vectorized
    pub(crate) fn excluded_side(&self, TriangleSide { mesh, side }: TriangleSide) -> PhotonSide {
        self.areas.map_or(PhotonSide::NONE, |areas| PhotonSide::other(areas.side_tag(mesh, side)))
    }

    /// The nested radii at this share of the merge radii.
    #[inline(always)] // part of vectorized code
    pub(super) fn nested(&self, share: f32) -> ByClass<f32> {
        from_fn(
            |class| if self.nests[class] { share * self.radii[class] } else { self.radii[class] },
        )
    }

    /// The kernel at the points of the wanted lanes, with the kernels at nested radii.
    #[inline(always)] // vectorized
    pub(super) fn at(
        &self,
        points: &GatherPacket,
        wanted: &Mask,
        nested: NestedRadii,
    ) -> PointKernels {
        let Some(areas) = self.areas else {
            let [caustic, diffuse] = self.radii.map(disc_area);
            return PointKernels {
                domain: [Domain::default(); LANES],
                inverse_area: [diffuse.recip(); LANES],
                caustic: [diffuse / caustic; LANES],
                nested: NESTED.map(|share| {
                    let nested = self.nested(share);
                    from_fn(|class| [(self.radii[class] / nested[class]).powi(2); LANES])
                }),
            };
        };
        let facet = from_fn(|lane| {
            if wanted[lane] { areas.number(points.mesh[lane], points.side[lane]) } else { 0 }
        });
        let query = Query { position: &points.position, facet: &facet, wanted };
        let [inner, half] = NESTED.map(|share| self.nested(share));
        // One area at each radius where the classes share it, else one for each class.
        if self.radii[CAUSTIC] == self.radii[DIFFUSE] {
            let [radius, inner, half] = [self.radii, inner, half].map(|radii| radii[DIFFUSE]);
            return match nested {
                NestedRadii::None => from_areas::<1, _>(areas.areas(&query, &[radius])),
                NestedRadii::Half => from_areas::<1, _>(areas.areas(&query, &[radius, half])),
                NestedRadii::Both => {
                    from_areas::<1, _>(areas.areas(&query, &[radius, half, inner]))
                }
            };
        }
        let ([caustic, diffuse], [c_half, d_half], [c_inner, d_inner]) = (self.radii, half, inner);
        match nested {
            NestedRadii::None => from_areas::<2, _>(areas.areas(&query, &[caustic, diffuse])),
            NestedRadii::Half => {
                from_areas::<2, _>(areas.areas(&query, &[caustic, diffuse, c_half, d_half]))
            }
            NestedRadii::Both => from_areas::<2, _>(
                areas.areas(&query, &[caustic, diffuse, c_half, d_half, c_inner, d_inner]),
            ),
        }
    }
}

/// Kernels from areas at the merge radii, at half and at `1/sqrt(2)` of them, as far as these were
/// computed. Each is one area for all photons, or one for each of two classes.
#[inline(always)] // vectorized
fn from_areas<const CLASSES: usize, const N: usize>(found: PointAreas<N>) -> PointKernels {
    let PointAreas { areas, domain } = found;
    let of_class = |class: usize| class.min(CLASSES - 1);
    let over = |at: usize| -> ByClass<[f32; LANES]> {
        let quotient = |class: usize| {
            areas
                .get(CLASSES * at + class)
                .map_or([0.0; LANES], |inner| from_fn(|lane| areas[class][lane] / inner[lane]))
        };
        [quotient(of_class(CAUSTIC)), quotient(of_class(DIFFUSE))]
    };
    let [caustic, diffuse] = [CAUSTIC, DIFFUSE].map(|class| areas[of_class(class)]);
    PointKernels {
        domain,
        inverse_area: diffuse.map(f32::recip),
        caustic: from_fn(|lane| if CLASSES == 1 { 1.0 } else { diffuse[lane] / caustic[lane] }),
        nested: [over(2), over(1)],
    }
}

impl PointKernels {
    /// Flux of a photon class in the outer annulus at the point of a lane, W, scaled to the kernel
    /// of diffuse photons: the flux `all` within the merge radius, less the flux `inner` within
    /// half of it, which counts by the kernel at half the radius. Its mean is the bias that the
    /// annulus adds.
    #[inline(always)] // part of vectorized code
    pub fn annulus(&self, lane: usize, class: usize, all: Vec3, inner: Vec3) -> Vec3 {
        let relative = if class == CAUSTIC { self.caustic[lane] } else { 1.0 };
        relative * (all - self.nested[1][class][lane] * inner)
    }

    /// Flux of both photon classes at the point of a lane, W, scaled to the kernel of diffuse
    /// photons.
    #[inline(always)] // part of vectorized code
    pub fn total(&self, lane: usize, flux: &ByClass<Vec3s>) -> Vec3 {
        flux[DIFFUSE].get(lane) + self.caustic[lane] * flux[CAUSTIC].get(lane)
    }

    /// The kernel at the point of one lane.
    #[inline(always)] // part of vectorized code
    pub fn get(&self, lane: usize) -> PointKernel {
        PointKernel {
            inverse_area: self.inverse_area[lane],
            caustic: self.caustic[lane],
            nested: self.nested.map(|nested| nested.map(|class| class[lane])),
        }
    }
}

impl PointKernel {
    /// The kernel of each photon class over the kernel for diffuse photons.
    #[inline(always)] // part of vectorized code
    pub fn relative(&self) -> ByClass<f32> {
        let mut relative = [1.0; 2];
        relative[CAUSTIC] = self.caustic;
        relative
    }
}
