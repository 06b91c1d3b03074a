//! Light that may arrive straight at a plane: a proof that none does must not overlook any.

use super::emitter::Emitter;
use crate::base::math::{Bounds, Rgb};
use crate::base::rng::Rng;
use crate::scene::Triangle;
use glam::{BVec3, Vec3};

/// Rounding of heights above a plane, over the largest coordinate.
const ROUNDING: f32 = 1e-6;

/// A plane that receives light on the side of its normal.
#[derive(Clone, Copy, Debug)]
pub struct Horizon {
    position: Vec3,
    normal: Vec3,
}

/// Light of an emitter that may arrive straight at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StraightLight {
    /// None arrives, whatever is in between.
    None,
    /// Light from this point arrives, unless something is in between.
    From(Vec3),
    /// Light of a surface may arrive.
    OfSurface,
}

impl Horizon {
    /// The plane through a position with this unit normal.
    pub fn new(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal }
    }

    /// Returns true if a point is above the plane by more than rounding.
    fn is_above(&self, point: Vec3) -> bool {
        let largest = point.abs().max(self.position.abs()).max_element();
        // The difference of two coordinates is exact to their own rounding.
        (point - self.position).dot(self.normal) > ROUNDING * largest
    }

    /// Returns true if any part of a box may be above the plane.
    pub fn may_show(&self, bounds: &Bounds) -> bool {
        let is_empty = bounds.min.cmpgt(bounds.max).any();
        let is_upper: BVec3 = self.normal.cmpgt(Vec3::ZERO);
        let highest = Vec3::select(is_upper, bounds.max, bounds.min);
        !is_empty && (!highest.is_finite() || self.is_above(highest))
    }

    /// Returns true if directions with a polar angle from +y in this interval, radians, may be
    /// above the plane.
    pub fn may_show_latitudes(&self, [low, high]: [f32; 2]) -> bool {
        let own = self.normal.y.clamp(-1.0, 1.0).acos();
        let nearest = own.clamp(low, high);
        (nearest - own).abs() < std::f32::consts::FRAC_PI_2 - 1e-5
    }

    /// Returns true if a triangle may shine from its front to the position from above the plane.
    fn may_show_front(&self, shape: &Triangle) -> bool {
        let corners = [Vec3::ZERO, shape.edge1, shape.edge2].map(|edge| shape.origin + edge);
        let faces = Self::new(shape.origin, shape.normal).is_above(self.position);
        faces && corners.into_iter().any(|corner| self.is_above(corner))
    }
}

impl Emitter {
    /// Light that may arrive straight at the position of a plane, on the side of its normal.
    pub fn straight_light(&self, at: &Horizon) -> StraightLight {
        let surfaces = self.triangles();
        if !surfaces.is_empty() {
            return match surfaces.iter().any(|shape| at.may_show_front(shape)) {
                true => StraightLight::OfSurface,
                false => StraightLight::None,
            };
        }
        // A lamp at the position itself has no direction.
        if self.position() == Some(at.position) {
            return StraightLight::OfSurface;
        }
        // Lights without a surface draw no numbers.
        match self.connect(at.position, 1.0, &mut Rng::default()) {
            Some(sample) if sample.irradiance != Rgb::ZERO && sample.wi.dot(at.normal) > 0.0 => {
                StraightLight::From(sample.target)
            }
            _ => StraightLight::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Directional, Spot};

    fn up() -> Horizon {
        Horizon::new(Vec3::new(1.0, 0.0, 0.0), Vec3::Y)
    }

    #[test]
    fn boxes_show_only_what_is_above_the_plane() {
        let of = |low: f32, high: f32| Bounds {
            min: Vec3::new(-5.0, low, -5.0),
            max: Vec3::new(5.0, high, 5.0),
        };
        assert!(!up().may_show(&of(-1.0, 0.0)) && up().may_show(&of(-1.0, 0.1)));
        assert!(!up().may_show(&Bounds::EMPTY));
        let down = Horizon::new(Vec3::ZERO, Vec3::NEG_Y);
        assert!(down.may_show(&of(-1.0, 0.0)) && !down.may_show(&of(0.0, 3.0)));
    }

    #[test]
    fn latitudes_below_the_horizon_are_not_shown() {
        let half = std::f32::consts::FRAC_PI_2;
        assert!(up().may_show_latitudes([0.0, half]));
        assert!(!up().may_show_latitudes([half, 2.0 * half]));
        let wall = Horizon::new(Vec3::ZERO, Vec3::X);
        assert!(wall.may_show_latitudes([0.1, 0.2]));
    }

    #[test]
    fn spots_light_their_cone_and_suns_the_planes_that_face_them() {
        let spot = |x: f32| {
            Emitter::Spot(Spot {
                position: Vec3::new(x, 2.0, 0.0),
                direction: Vec3::NEG_Y,
                intensity: Rgb::ONE,
                cos_inner: 0.95,
                cos_outer: 0.9,
                falloff: crate::scene::lights::emitter::Falloff::default(),
            })
        };
        let from = |x: f32| StraightLight::From(Vec3::new(x, 2.0, 0.0));
        assert_eq!(spot(1.2).straight_light(&up()), from(1.2));
        assert_eq!(spot(4.0).straight_light(&up()), StraightLight::None, "outside of the cone");
        let sun = |y: f32| Emitter::Directional(Directional::new(Vec3::new(0.0, y, 0.0), Rgb::ONE));
        assert!(matches!(sun(-1.0).straight_light(&up()), StraightLight::From(_)));
        assert_eq!(sun(1.0).straight_light(&up()), StraightLight::None, "from below");
        let point =
            |y: f32| Emitter::Point { position: Vec3::new(1.0, y, 0.0), intensity: Rgb::ONE };
        assert_eq!(point(-1.0).straight_light(&up()), StraightLight::None);
        assert_eq!(point(0.0).straight_light(&up()), StraightLight::OfSurface, "at the meter");
    }
}
