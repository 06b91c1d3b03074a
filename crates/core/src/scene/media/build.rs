//! Lists the media of a scene, their boundaries, and all sets of media that paths may be inside of.

use super::{Boundary, Media, MediumBoundary, MediumState, Members, State};
use crate::base::error::{Error, Result};
use crate::base::math::Bounds;
use crate::scene::{Material, Medium, Mesh, Placement};
use std::sync::Arc;

impl Media {
    /// Lists the media of these materials; `None` if there are none. `all` fills the space between
    /// all others.
    ///
    /// # Errors
    /// If there are too many media, or they nest in too many ways.
    pub(in crate::scene) fn new(
        meshes: &[Mesh],
        placements: &[Placement],
        materials: &[Material],
        all: Option<&Arc<Medium>>,
    ) -> Result<Option<Self>> {
        let mut media = NumberedMedia::default();
        let filling = media.number(all);
        // An object with nothing but an exterior is empty, not filled.
        let vacuum = (filling != 0).then(|| Arc::new(Medium::vacuum()));
        let of_material: Vec<Option<Boundary>> = materials
            .iter()
            .map(|material| {
                let MediumBoundary { interior, exterior } = material.boundary.as_ref()?;
                let interior = if interior.is_none() { &vacuum } else { interior };
                Some(Boundary {
                    interior: media.number(interior.as_ref()),
                    exterior: media.number(exterior.as_ref()),
                    is_index_matched: material.is_index_matched_boundary(),
                })
            })
            .collect();
        let media = media.0;
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
        let states = reachable_states(&boundaries, &meets, &order, filling)?;
        Ok(Some(Self { media, states, boundary_of, boundaries }))
    }
}

/// Media that have got a number, each once.
#[derive(Default)]
struct NumberedMedia(Vec<Arc<Medium>>);

impl NumberedMedia {
    /// The set of a medium alone; empty without one, and for media beyond the most that sets hold.
    fn number(&mut self, medium: Option<&Arc<Medium>>) -> Members {
        let Some(medium) = medium else { return 0 };
        let known = self.0.iter().position(|known| known == medium);
        let index = known.unwrap_or_else(|| {
            self.0.push(medium.clone());
            self.0.len() - 1
        });
        1_u64.checked_shl(index as u32).unwrap_or(0)
    }
}

/// All sets of media that paths can reach from outside of all objects, and the crossings between
/// them.
fn reachable_states(
    boundaries: &[Boundary],
    meets: &[Members],
    order: &[u8],
    filling: Members,
) -> Result<Vec<State>> {
    let mut states: Vec<State> = Vec::new();
    let mut reached = vec![filling];
    while let Some(&members) = reached.get(states.len()) {
        let next = boundaries.iter().map(|boundary| {
            [true, false].map(|to_back| {
                let after = boundary.cross(members, to_back, meets) | filling;
                let known = reached.iter().position(|known| *known == after);
                let number = known.unwrap_or_else(|| {
                    reached.push(after);
                    reached.len() - 1
                });
                MediumState(number.min(u8::MAX.into()) as u8)
            })
        });
        let next = next.collect();
        if reached.len() > MediumState::COUNT {
            return Err(Error::new(
                "the media of the scene overlap in more than 64 ways",
                "use one medium for objects of the same material, or move them apart",
            ));
        }
        let medium = order.iter().copied().find(|&index| members >> index & 1 == 1);
        states.push(State { members, medium, next });
    }
    Ok(states)
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
