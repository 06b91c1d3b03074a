//! Projections of fisheye lenses.

use glam::{Vec2, Vec3};
use serde::Serialize;

/// Projection of a fisheye lens: the distance of an image point from the center by the angle from
/// the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum FisheyeProjection {
    /// The distance is proportional to the angle.
    Equidistant,
    /// The distance is proportional to the sine of half the angle: all pixels show the same solid
    /// angle.
    Equisolid,
}

impl FisheyeProjection {
    /// All projections.
    pub const ALL: [Self; 2] = [Self::Equidistant, Self::Equisolid];

    /// Name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Equidistant => "equidistant",
            Self::Equisolid => "equisolid",
        }
    }

    /// Angle from the axis, radians, at the distance `share` of the radius of the image circle, in
    /// [0, 1]. The edge of the circle is at the angle `edge`, in (0, pi].
    fn angle(self, share: f32, edge: f32) -> f32 {
        match self {
            Self::Equidistant => share * edge,
            Self::Equisolid => 2.0 * (share * (0.5 * edge).sin()).min(1.0).asin(),
        }
    }

    /// Unit direction of the image point `at`, in radii of the image circle to the right and up
    /// from its center; `None` outside the circle. In the result, +x is right, +y up and +z the
    /// axis.
    pub(super) fn direction(self, at: Vec2, edge: f32) -> Option<Vec3> {
        let share = at.length();
        if share > 1.0 {
            return None;
        }
        let (sin, cos) = self.angle(share, edge).sin_cos();
        Some((sin * at.normalize_or_zero()).extend(cos))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::{FRAC_PI_2, PI};

    #[test]
    fn fisheyes_reach_their_field_of_view_at_the_edge_of_the_image_circle() {
        for projection in FisheyeProjection::ALL {
            for edge in [0.3_f32, FRAC_PI_2, PI] {
                let direction = projection.direction(Vec2::new(0.0, 0.999_999), edge).unwrap();
                let expected = Vec3::new(0.0, edge.sin(), edge.cos());
                assert!((direction - expected).length() < 5e-3, "{projection:?}: {direction}");
                assert_eq!(projection.direction(Vec2::ZERO, edge), Some(Vec3::Z));
                assert_eq!(projection.direction(Vec2::new(0.8, 0.8), edge), None);
            }
        }
        // Half the radius of a dome: half the angle, or asin(sin(45 deg) / 2) twice.
        let at = Vec2::new(0.5, 0.0);
        let angle = |projection: FisheyeProjection| {
            projection.direction(at, FRAC_PI_2).unwrap().z.acos().to_degrees()
        };
        assert!((angle(FisheyeProjection::Equidistant) - 45.0).abs() < 1e-3);
        assert!((angle(FisheyeProjection::Equisolid) - 41.409_6).abs() < 1e-3);
    }
}
