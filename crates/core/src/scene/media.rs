//! Which medium fills the space around a path.
//!
//! Boundaries of media are surfaces whose material names the media on its two sides. A path carries
//! a [`MediumState`], the number of a set of media that it is inside of, and each boundary that it
//! crosses leads from one state to another. All states that paths can reach are listed when the
//! scene is built, so that a crossing is one look-up. theory.md, section 9a.

use super::medium::Medium;
use super::{Material, Mesh, Placement, Scene, Surface};
use crate::accel::{Hit, Intersect, Ray, next_after};
use crate::base::error::{Error, Result};
use crate::base::math::{Bounds, Rgb};
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

/// Number of the set of media that a path is inside of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumState(pub(crate) u8);

impl MediumState {
    /// Number of states that a scene may have.
    pub(crate) const COUNT: usize = 64;
}

/// The media that a material separates.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MediumBoundary {
    /// Medium behind the surface; `None` if nothing is known of it.
    pub interior: Option<Arc<Medium>>,
    /// Medium in front of the surface, if it is not that of the object around it.
    pub exterior: Option<Arc<Medium>>,
}

/// A set of media, one bit each.
type Members = u64;

/// Media of a scene, their boundaries, and all sets of media that a path may be inside of.
#[derive(Debug)]
pub struct Media {
    media: Vec<Arc<Medium>>,
    states: Vec<State>,
    /// For each placement the number of its boundary, if it is one.
    boundary_of: Vec<Option<u16>>,
    boundaries: Vec<Boundary>,
}

#[derive(Debug)]
struct State {
    members: Members,
    /// Index of the medium that fills the space.
    medium: Option<u8>,
    /// For each boundary the states after a crossing to the back and to the front.
    next: Vec<[MediumState; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Boundary {
    /// Sets of at most one medium.
    interior: Members,
    exterior: Members,
    /// Paths go straight on.
    is_index_matched: bool,
}

impl Boundary {
    /// The set of media after a crossing, without any that never meets the new one.
    fn cross(&self, members: Members, to_back: bool, meets: &[Members]) -> Members {
        let (left, entered) =
            if to_back { (self.exterior, self.interior) } else { (self.interior, self.exterior) };
        let others = members & !left;
        if entered == 0 {
            return others;
        }
        others & meets[entered.trailing_zeros() as usize] | entered
    }
}

impl Media {
    /// Lists the media of these materials; `None` if there are none. `all` fills the space between
    /// all others.
    ///
    /// # Errors
    /// If there are too many media, or they nest in too many ways.
    pub(super) fn new(
        meshes: &[Mesh],
        placements: &[Placement],
        materials: &[Material],
        all: Option<&Arc<Medium>>,
    ) -> Result<Option<Self>> {
        let mut media: Vec<Arc<Medium>> = Vec::new();
        let mut number = |medium: &Option<Arc<Medium>>| -> Members {
            let Some(medium) = medium else { return 0 };
            let known = media.iter().position(|known| known == medium);
            let index = known.unwrap_or_else(|| {
                media.push(medium.clone());
                media.len() - 1
            });
            1_u64.checked_shl(index as u32).unwrap_or(0)
        };
        let filling = number(&all.cloned());
        // An object with nothing but an exterior is empty, not filled.
        let vacuum = (filling != 0).then(|| Arc::new(Medium::vacuum()));
        let of_material: Vec<Option<Boundary>> = materials
            .iter()
            .map(|material| {
                let MediumBoundary { interior, exterior } = material.boundary.as_ref()?;
                let interior = if interior.is_none() { &vacuum } else { interior };
                Some(Boundary {
                    interior: number(interior),
                    exterior: number(exterior),
                    is_index_matched: material.is_index_matched_boundary(),
                })
            })
            .collect();
        if of_material.iter().all(Option::is_none) && filling == 0 {
            return Ok(None);
        }
        if media.len() > Members::BITS as usize {
            let problem = format!("the scene has {} media, of at most 64", media.len());
            return Err(Error::new(problem, "use one medium for objects of the same material"));
        }
        let mut boundaries: Vec<Boundary> = Vec::new();
        let boundary_of = placements.iter().map(|placement| {
            let own = of_material[placement.material as usize]?;
            let known = boundaries.iter().position(|known| *known == own);
            Some(known.unwrap_or_else(|| {
                boundaries.push(own);
                boundaries.len() - 1
            }) as u16)
        });
        let boundary_of = boundary_of.collect();
        let extents = extents(media.len(), meshes, placements, &of_material);
        let meets = meetings(&extents, filling);
        let order = by_precedence(&media, &extents, filling);
        let mut states: Vec<State> = Vec::new();
        let mut found = vec![filling];
        while let Some(&members) = found.get(states.len()) {
            let next = boundaries.iter().map(|boundary| {
                [true, false].map(|to_back| {
                    let after = boundary.cross(members, to_back, &meets) | filling;
                    let known = found.iter().position(|known| *known == after);
                    let number = known.unwrap_or_else(|| {
                        found.push(after);
                        found.len() - 1
                    });
                    MediumState(number.min(u8::MAX.into()) as u8)
                })
            });
            let next = next.collect();
            if found.len() > MediumState::COUNT {
                let problem = "the media of the scene overlap in more than 64 ways";
                return Err(Error::new(
                    problem,
                    "use one medium for objects of the same material, or move them apart",
                ));
            }
            let medium = order.iter().copied().find(|&index| members >> index & 1 == 1);
            states.push(State { members, medium, next });
        }
        Ok(Some(Self { media, states, boundary_of, boundaries }))
    }

    /// All media.
    pub fn media(&self) -> &[Arc<Medium>] {
        &self.media
    }

    /// Returns true if a medium scatters light.
    pub fn any_scatters(&self) -> bool {
        self.media.iter().any(|medium| medium.scatters())
    }

    /// Largest extinction coefficient of the media that scatter, of any color, 1/scene unit; 0
    /// without such media.
    pub fn largest_extinction(&self) -> f32 {
        let scattering = self.media.iter().filter(|medium| medium.scatters());
        scattering.map(|medium| medium.extinction().max_element()).fold(0.0, f32::max)
    }

    /// Largest share of the light that a medium scatters and does not absorb, of any color; 0
    /// without media that scatter.
    pub fn largest_albedo(&self) -> f32 {
        let scattering = self.media.iter().filter(|medium| medium.scatters());
        // A color that meets nothing has none.
        let albedo =
            |own: &Medium| own.scattering / own.extinction().max(Rgb::splat(f32::MIN_POSITIVE));
        scattering.map(|medium| albedo(medium).max_element()).fold(0.0, f32::max)
    }

    /// Returns true if the weights of merges among several techniques (`mis`, `cut-mis`) hold: they
    /// know neither vertices in media, nor light paths that start anew behind a boundary.
    pub fn allows_weighted_merges(&self) -> bool {
        !self.any_scatters() && !self.has_index_matched()
    }

    /// The medium that fills the space in a state; `None` for empty space.
    #[inline]
    pub fn medium(&self, state: MediumState) -> Option<&Medium> {
        let index = self.states[usize::from(state.0)].medium?;
        Some(&self.media[usize::from(index)])
    }

    /// The state after a path crosses a surface of this placement, to its back if it comes from the
    /// front.
    #[inline]
    pub fn cross(&self, state: MediumState, placement: u32, from_front: bool) -> MediumState {
        match self.boundary_of[placement as usize] {
            None => state,
            Some(boundary) => {
                let [to_back, to_front] =
                    self.states[usize::from(state.0)].next[usize::from(boundary)];
                if from_front { to_back } else { to_front }
            }
        }
    }

    /// The state after a path leaves a surface along `direction`.
    #[inline]
    pub fn after(&self, state: MediumState, surface: &Surface, direction: Vec3) -> MediumState {
        if surface.normal.dot(direction) >= 0.0 {
            return state;
        }
        self.cross(state, surface.facet.mesh, surface.front)
    }

    /// Returns true if paths go straight through surfaces of this placement.
    #[inline]
    pub fn is_index_matched(&self, placement: u32) -> bool {
        let boundary = self.boundary_of.get(placement as usize).copied().flatten();
        boundary.is_some_and(|number| self.boundaries[usize::from(number)].is_index_matched)
    }

    /// Returns true if the surfaces of a placement bound a medium.
    pub(super) fn bounds_medium(&self, placement: u32) -> bool {
        self.boundary_of[placement as usize].is_some()
    }

    /// Returns true if paths go straight through any surface.
    fn has_index_matched(&self) -> bool {
        self.boundaries.iter().any(|boundary| boundary.is_index_matched)
    }

    /// The state at a point, by the boundaries around it: the first crossing of each medium's
    /// boundary by a ray tells on which side the point is.
    pub fn at(&self, scene: &Scene, accel: &dyn Intersect, point: Vec3) -> MediumState {
        // Along no axis, edge or diagonal of common models.
        let ray = Ray::new(point, Vec3::new(0.431_6, 0.276_1, 0.858_8).normalize());
        let (mut seen, mut members) = (0, self.states[0].members);
        let (mut hit, mut step) = (accel.closest_hit(&ray), f32::EPSILON);
        while !hit.is_miss() {
            if let Some(number) = self.boundary_of[hit.mesh as usize] {
                let Boundary { interior, exterior, .. } = self.boundaries[usize::from(number)];
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                let (near, far) = if normal.dot(ray.direction) < 0.0 {
                    (exterior, interior)
                } else {
                    (interior, exterior)
                };
                members |= near & !seen;
                seen |= near | far;
            }
            (hit, step) = next_after(accel, &ray, &hit, step);
        }
        let same = |state: &State| state.members == members;
        // Sets that no path reaches belong to surfaces that are not closed.
        MediumState(self.states.iter().position(same).unwrap_or(0) as u8)
    }

    /// Transmittance of the segment between two points that nothing but index-matched surfaces
    /// blocks. A path in the state `state` is at `from`. theory.md (37f)
    pub fn transmittance(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        state: MediumState,
        [from, to]: [Vec3; 2],
    ) -> Rgb {
        let length = from.distance(to);
        let through = |state: MediumState, share: f32| {
            self.medium(state).map_or(Rgb::ONE, |medium| medium.transmittance(share * length))
        };
        if !self.has_index_matched() {
            return through(state, 1.0);
        }
        let ray = Ray::segment(from, to);
        let (mut state, mut start, mut total) = (state, 0.0, Rgb::ONE);
        let (mut hit, mut step): (Hit, _) = (accel.closest_hit(&ray), f32::EPSILON);
        while !hit.is_miss() && hit.t < 1.0 {
            if self.is_index_matched(hit.mesh) {
                total *= through(state, hit.t - start);
                start = hit.t;
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                state = self.cross(state, hit.mesh, normal.dot(ray.direction) < 0.0);
            }
            (hit, step) = next_after(accel, &ray, &hit, step);
        }
        total * through(state, 1.0 - start)
    }
}

impl Scene {
    /// The media of the scene, if there are any.
    #[inline]
    pub fn media(&self) -> Option<&Media> {
        self.media.as_deref()
    }

    /// The medium that fills the space between all others, if there is one.
    pub fn filling_medium(&self) -> Option<&Arc<Medium>> {
        self.filling_medium.as_ref()
    }

    /// The scene with a medium between all others, without bounds.
    ///
    /// # Errors
    /// If light would have to come from infinitely far, or there are too many media.
    pub fn with_filling_medium(mut self, medium: Option<Arc<Medium>>) -> Result<Self> {
        // A medium that neither absorbs nor scatters is empty space.
        let medium = medium.filter(|own| own.absorption + own.scattering != Rgb::ZERO);
        let lights = self.lights();
        let is_far = |emitter: &super::Emitter| matches!(emitter, super::Emitter::Directional(_));
        if medium.is_some() && (lights.has_environment() || lights.emitters().iter().any(is_far)) {
            let problem =
                "a medium without bounds absorbs all light of environments, skies and suns";
            let advice = "put the medium into a closed object that is large enough, with index-matched surfaces";
            return Err(Error::new(problem, advice));
        }
        let (meshes, placements) = (&self.meshes, &self.placements);
        let media = Media::new(meshes, placements, &self.materials, medium.as_ref())?;
        self.media = media.map(Arc::new);
        self.filling_medium = medium;
        Ok(self)
    }
}

/// For each medium the boxes of the objects that hold it.
fn extents(
    media: usize,
    meshes: &[Mesh],
    placements: &[Placement],
    of_material: &[Option<Boundary>],
) -> Vec<Vec<Bounds>> {
    let mut extents = vec![Vec::new(); media];
    for placement in placements {
        let Some(boundary) = of_material[placement.material as usize] else { continue };
        let bounds = placement.enclose(Bounds::EMPTY, &meshes[placement.mesh as usize]);
        for members in [boundary.interior, boundary.exterior] {
            if members != 0 {
                extents[members.trailing_zeros() as usize].push(bounds);
            }
        }
    }
    extents
}

/// Maximum number of pairs of objects whose boxes are compared.
const MAX_PAIRS: usize = 10_000_000;

/// For each medium the set of those that it may overlap: their objects' boxes do. `filling`
/// overlaps all.
fn meetings(extents: &[Vec<Bounds>], filling: Members) -> Vec<Members> {
    let touch = |a: &Bounds, b: &Bounds| a.min.cmple(b.max).all() && b.min.cmple(a.max).all();
    let whole = |boxes: &[Bounds]| {
        let all = boxes.iter().fold(Bounds::EMPTY, |all, own| all.with(own.min).with(own.max));
        (!boxes.is_empty()).then_some(all)
    };
    let meet = |a: &[Bounds], b: &[Bounds]| {
        let (Some(all_a), Some(all_b)) = (whole(a), whole(b)) else { return false };
        // Of very many objects it is enough that they may overlap.
        touch(&all_a, &all_b)
            && (a.len().saturating_mul(b.len()) > MAX_PAIRS
                || a.iter().any(|a| b.iter().any(|b| touch(a, b))))
    };
    let set = |one: &Vec<Bounds>| {
        let others = extents.iter().enumerate().filter(|(_, other)| meet(one, other));
        others.fold(filling, |set, (index, _)| set | 1 << index)
    };
    extents.iter().map(set).collect()
}

/// Indices of the media: the first of those in a set fills the space.
fn by_precedence(media: &[Arc<Medium>], extents: &[Vec<Bounds>], filling: Members) -> Vec<u8> {
    let volume = |index: u8| -> f32 {
        let boxes = extents[usize::from(index)].iter();
        boxes.map(|bounds| (bounds.max - bounds.min).element_product()).fold(0.0, f32::max)
    };
    let mut order: Vec<u8> = (0..media.len() as u8).collect();
    order.sort_by(|&a, &b| {
        let is_filling = |index: u8| filling >> index & 1 == 1;
        let priority = |index: u8| media[usize::from(index)].priority;
        (is_filling(a).cmp(&is_filling(b)))
            .then(priority(b).cmp(&priority(a)))
            .then(volume(a).total_cmp(&volume(b)))
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::bvh::Bvh;
    use crate::scene::bsdf::{Bsdf, Dielectric, ThinDielectric};
    use crate::scene::{Camera, FieldOfView};

    fn medium(name: &str, priority: i32) -> Arc<Medium> {
        let absorption = Rgb::splat(name.len() as f32);
        let (scattering, asymmetry) = (Rgb::ZERO, 0.0);
        Arc::new(Medium { name: name.into(), absorption, scattering, asymmetry, priority })
    }

    fn material(boundary: MediumBoundary, bsdf: Bsdf) -> Material {
        Material { boundary: Some(boundary), ..Material::new("some", bsdf) }
    }

    fn inside(interior: &Arc<Medium>) -> MediumBoundary {
        MediumBoundary { interior: Some(interior.clone()), exterior: None }
    }

    /// A box with fronts outside.
    fn block(low: Vec3, high: Vec3, material: u32) -> Mesh {
        let corner = |i: usize| {
            Vec3::new(
                if i & 1 == 0 { low.x } else { high.x },
                if i & 2 == 0 { low.y } else { high.y },
                if i & 4 == 0 { low.z } else { high.z },
            )
        };
        let sides =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh { positions: (0..8).map(corner).collect(), triangles, material, ..Mesh::default() }
    }

    fn scene(meshes: Vec<Mesh>, materials: Vec<Material>) -> Scene {
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        Scene::new("test".into(), meshes, materials, vec![], camera, vec![]).unwrap()
    }

    fn name_at(scene: &Scene, point: Vec3) -> Option<String> {
        let accel = Bvh::new(&scene.geometry()).unwrap();
        let media = scene.media().unwrap();
        media.medium(media.at(scene, &accel, point)).map(|medium| medium.name.clone())
    }

    /// A medium between all objects does not enter an object that has an exterior only.
    #[test]
    fn objects_with_an_exterior_only_are_empty() {
        let (smoke, water) = (medium("smoke", 0), medium("water", 0));
        let glass = Bsdf::Dielectric(Dielectric::new(1.5));
        let outside = MediumBoundary { interior: None, exterior: Some(smoke.clone()) };
        let materials = vec![material(outside, glass), material(inside(&water), glass)];
        let meshes = vec![
            block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
            block(Vec3::splat(-1.0), Vec3::splat(1.0), 1),
        ];
        let scene = scene(meshes, materials).with_filling_medium(Some(smoke)).unwrap();
        for (x, name) in [(0.0, "water"), (1.5, "vacuum"), (2.5, "smoke")] {
            let found = name_at(&scene, Vec3::new(x, 0.1, 0.2));
            assert_eq!(found.as_deref(), Some(name), "{x}");
        }
        let media = scene.media().unwrap();
        let mut state = media.at(&scene, &Bvh::new(&scene.geometry()).unwrap(), 3.0 * Vec3::X);
        for (placement, from_front, name) in
            [(0, true, "vacuum"), (1, true, "water"), (1, false, "vacuum"), (0, false, "smoke")]
        {
            state = media.cross(state, placement, from_front);
            assert_eq!(media.medium(state).unwrap().name, name);
        }
    }

    /// Ice in water: the smaller object counts. A bubble in the ice has an exterior, the ice.
    #[test]
    fn smallest_object_fills_the_space() {
        let (water, ice, air) = (medium("water", 0), medium("ice", 0), medium("a", 0));
        let glass = Bsdf::Dielectric(Dielectric::new(1.3));
        let bubble = MediumBoundary { interior: Some(air), exterior: Some(ice.clone()) };
        let materials = vec![
            material(inside(&water), glass),
            material(inside(&ice), glass),
            material(bubble, glass),
        ];
        let cube = |half: f32, material| block(Vec3::splat(-half), Vec3::splat(half), material);
        let scene = scene(vec![cube(3.0, 0), cube(2.0, 1), cube(1.0, 2)], materials);
        for (x, name) in [(0.0, Some("a")), (1.5, Some("ice")), (2.5, Some("water")), (4.0, None)] {
            let found = name_at(&scene, Vec3::new(x, 0.1, 0.2));
            assert_eq!(found.as_deref(), name, "{x}");
        }
        // A path through all of them, and back
        let media = scene.media().unwrap();
        let mut state = MediumState::default();
        let mut names = Vec::new();
        for (placement, from_front) in
            [(0, true), (1, true), (2, true), (2, false), (1, false), (0, false)]
        {
            state = media.cross(state, placement, from_front);
            names.push(media.medium(state).map_or("none", |medium| &medium.name));
        }
        assert_eq!(names, ["water", "ice", "a", "ice", "water", "none"]);
        assert_eq!(state, MediumState::default());
    }

    #[test]
    fn priority_comes_before_size() {
        let (large, small) = (medium("large", 1), medium("small", 0));
        let glass = Bsdf::Dielectric(Dielectric::new(1.3));
        let materials = vec![material(inside(&large), glass), material(inside(&small), glass)];
        let meshes = vec![
            block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
            block(Vec3::new(1.0, -1.0, -1.0), Vec3::new(3.0, 1.0, 1.0), 1),
        ];
        let scene = scene(meshes, materials);
        for (x, name) in [(0.5, "large"), (1.5, "large"), (2.5, "small")] {
            assert_eq!(name_at(&scene, Vec3::new(x, 0.1, 0.2)).as_deref(), Some(name), "{x}");
        }
    }

    #[test]
    fn segments_lose_light_in_all_media_that_they_cross() {
        let (one, other) = (medium("one", 0), medium("others", 0));
        let clear = Bsdf::ThinDielectric(ThinDielectric::new(1.0));
        let materials = vec![material(inside(&one), clear), material(inside(&other), clear)];
        let meshes = vec![
            block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
            block(Vec3::splat(-0.5), Vec3::splat(0.5), 1),
        ];
        let scene = scene(meshes, materials);
        let accel = Bvh::new(&scene.geometry()).unwrap();
        let (from, to) = (Vec3::new(-3.0, 0.1, 0.2), Vec3::new(3.0, 0.1, 0.2));
        let found = scene.media().unwrap().transmittance(
            &scene,
            &accel,
            MediumState::default(),
            [from, to],
        );
        let expected = (-3.0f32 * 3.0 - 6.0).exp();
        assert!((found.x / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    }

    #[test]
    fn media_apart_from_each_other_have_no_common_state() {
        let media: Vec<_> = (0..40).map(|i| medium(&"m".repeat(i + 1), 0)).collect();
        let glass = Bsdf::Dielectric(Dielectric::new(1.3));
        let materials = media.iter().map(|own| material(inside(own), glass)).collect();
        let at = |i: usize| Vec3::X * 2.0 * i as f32;
        let blocks = (0..40).map(|i| block(at(i), at(i) + Vec3::ONE, i as u32)).collect();
        let scene = scene(blocks, materials);
        assert_eq!(scene.media().unwrap().states.len(), 41);
    }

    #[test]
    fn too_many_ways_to_overlap_are_refused() {
        let media: Vec<_> = (0..7).map(|i| medium(&"m".repeat(i + 1), 0)).collect();
        let glass = Bsdf::Dielectric(Dielectric::new(1.3));
        let materials = media.iter().map(|own| material(inside(own), glass)).collect();
        let blocks = (0..7).map(|i| block(-Vec3::ONE, Vec3::ONE, i)).collect::<Vec<_>>();
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let refused = Scene::new("test".into(), blocks, materials, vec![], camera, vec![]);
        assert!(refused.unwrap_err().to_string().contains("in more than 64 ways"));
    }
}
