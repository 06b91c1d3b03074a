//! Polarization that is neglected between panes: by how much readings may be off. theory.md (30e)

use super::reading::Reading;
use super::render_meters::OfSet;
use bdpm_core::accel::Intersect;
use bdpm_core::base::math::{Frame, cosine_hemisphere};
use bdpm_core::scene::{Emitter, Meter, MeterKind, PaneStack, Scene};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::ops::Range;

/// Directions of a meter, and rays for all meters together.
const DIRECTIONS: usize = 32;
const RAYS: usize = 1 << 17;

/// Lights without a surface that are looked at, each from every meter.
const LIGHTS: usize = 16;

/// Largest relative error that is worth a note.
const NOTED: f64 = 1e-3;

/// Relative errors of a meter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Neglected {
    /// Of light that arrives straight.
    direct: f64,
    /// Of all other light.
    indirect: f64,
}

/// Relative errors of the meters of a scene by polarization that is neglected.
pub(super) struct NeglectedPolarization {
    of_meters: Vec<Neglected>,
}

impl NeglectedPolarization {
    /// `None` if the scene has no panes.
    pub fn new(scene: &Scene, accel: &dyn Intersect) -> Option<Self> {
        let meters = scene.meters().filter(|_| scene.has_panes())?;
        let count = (RAYS / meters.list.len()).clamp(2, DIRECTIONS);
        let of = |meter: &Meter| of_meter(scene, accel, (meters.kind, meter), count);
        Some(Self { of_meters: meters.list.par_iter().map(of).collect() })
    }

    /// The readings with wider intervals, and the largest relative widening if it is worth a note.
    /// `columns` are the meters of each set.
    pub fn add(&self, sets: &[OfSet], columns: &[Range<usize>]) -> (Vec<OfSet>, Option<f64>) {
        let mut worst: f64 = 0.0;
        let mut of_set = |((readings, mean), columns): (&OfSet, &Range<usize>)| {
            let own = &self.of_meters[columns.clone()];
            let bound = |(reading, own): (&Reading, &Neglected)| {
                own.direct * reading.direct.max(0.0) + own.indirect * reading.indirect().max(0.0)
            };
            let bounds: Vec<f64> = readings.iter().zip(own).map(bound).collect();
            let wider = |(reading, bound): (&Reading, &f64)| Reading {
                bias: reading.bias + bound,
                expanded: reading.expanded + bound,
                ..*reading
            };
            let lit = readings.iter().zip(&bounds).filter(|(reading, _)| reading.value > 0.0);
            worst = lit.map(|(reading, bound)| bound / reading.value).fold(worst, f64::max);
            let of_mean = bounds.iter().sum::<f64>() / bounds.len() as f64;
            let readings = readings.iter().zip(&bounds).map(wider).collect();
            (readings, wider((mean, &of_mean)))
        };
        let sets = sets.iter().zip(columns).map(&mut of_set).collect();
        (sets, (worst >= NOTED).then_some(worst))
    }
}

/// A note on the largest relative widening of an interval.
pub(super) fn note(name: &str, worst: f64) -> String {
    format!(
        "{name}: light is not polarized by reflections between panes, and by panes where it does not go straight to a \
         light: intervals are wider by up to {:.1} % of the value",
        100.0 * worst
    )
}

fn of_meter(
    scene: &Scene,
    accel: &dyn Intersect,
    (kind, meter): (MeterKind, &Meter),
    count: usize,
) -> Neglected {
    let stack = |direction: Vec3, distance: f32| {
        scene.pane_stack(accel, meter.position, direction, distance)
    };
    let count = if kind == MeterKind::Radiance && meter.half_angle == 0.0 { 1 } else { count };
    let directions = (0..count).map(|index| direction(kind, meter, index, count));
    let stacks: Vec<PaneStack> = directions.map(|own| stack(own, f32::INFINITY)).collect();
    // Mean over the directions, over the light that paths find to arrive from each.
    let mean = |share: fn(&PaneStack) -> f64| {
        let off: f64 = stacks.iter().map(|own| (share(own) - own.exact).abs()).sum();
        off / stacks.iter().map(share).sum::<f64>().max(1e-9)
    };
    if kind == MeterKind::Radiance {
        let all = mean(|own| own.by_faces);
        return Neglected { direct: all, indirect: all };
    }
    let lights = scene.lights().emitters().iter().filter(|own| own.is_delta()).take(LIGHTS);
    let of_light = |light: &Emitter| {
        let (direction, distance) = match light.parallel() {
            Some(light) => (-light.direction, f32::INFINITY),
            None => {
                let to_light = light.position().unwrap_or(meter.position) - meter.position;
                (to_light.normalize_or_zero(), to_light.length())
            }
        };
        if direction.dot(meter.normal) <= 0.0 {
            return 0.0;
        }
        let own = stack(direction, distance);
        (own.straight - own.exact).abs() / own.straight.max(1e-9)
    };
    let indirect = mean(|own| own.by_panes);
    let has_surfaces = scene.lights().emitters().iter().any(|own| !own.is_delta());
    let of_surfaces = if has_surfaces { indirect } else { 0.0 };
    let of_sky = if scene.lights().has_environment() { mean(|own| own.straight) } else { 0.0 };
    Neglected { direct: lights.map(of_light).fold(of_surfaces.max(of_sky), f64::max), indirect }
}

/// One of `count` directions of a meter, evenly spread: cosine-distributed around the normal, or in
/// the cone.
fn direction(kind: MeterKind, meter: &Meter, index: usize, count: usize) -> Vec3 {
    /// The golden ratio less 1.
    const TURN: f32 = 0.618_034;
    let u = [(index as f32 + 0.5) / count as f32, (index as f32 * TURN).fract()];
    match kind {
        MeterKind::Irradiance => cosine_hemisphere(meter.normal, u),
        MeterKind::Radiance => {
            let cos = 1.0 - u[0] * (1.0 - meter.half_angle.cos());
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            let (y, x) = (TAU * u[1]).sin_cos();
            Frame::new(meter.normal).to_world(Vec3::new(sin * x, sin * y, cos)).normalize()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::math::Rgb;
    use bdpm_core::scene::backend::{self, Backend};
    use bdpm_core::scene::bsdf::{Bsdf, Dielectric, ThinDielectric};
    use bdpm_core::scene::{Camera, Directional, FieldOfView, Material, Mesh};

    /// Faces of two slabs above the plane z = 0, or two sheets.
    fn scene(is_slab: bool, sun: Vec3) -> Scene {
        let face = |height: f32, up: bool| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            let positions = corners.map(|[x, y]| Vec3::new(90.0 * x, 90.0 * y, height));
            let order = if up { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
            Mesh { positions: positions.into(), triangles: order.into(), ..Mesh::default() }
        };
        let slabs = vec![face(1.0, false), face(1.1, true), face(2.0, false), face(2.1, true)];
        let (meshes, bsdf) = match is_slab {
            true => (slabs, Bsdf::Dielectric(Dielectric::new(1.5))),
            false => {
                let sheet = Bsdf::ThinDielectric(ThinDielectric::new(1.5));
                (vec![face(1.0, true), face(2.0, true)], sheet)
            }
        };
        let lights = vec![Emitter::Directional(Directional::new(sun, Rgb::ONE))];
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let glass = vec![Material::new("glass", bsdf)];
        Scene::new("two".into(), meshes, glass, lights, camera, vec![]).unwrap()
    }

    fn wider(scene: &Scene, kind: MeterKind, meter: Meter) -> f64 {
        let scene = scene.with_meters(kind, vec![meter]);
        let accel = backend::build(Backend::Bvh, &scene).unwrap();
        let own = NeglectedPolarization::new(&scene, &*accel).unwrap();
        let reading = Reading::new(1.0, 0.0, 0.0, 1.0, 1e6);
        let one = 0..1;
        let (sets, note) = own.add(&[(vec![reading], reading)], std::slice::from_ref(&one));
        let [(readings, mean)] = &sets[..] else { panic!("one set") };
        assert_eq!(readings[0], *mean);
        let width = readings[0].expanded / reading.value;
        assert_eq!(note.is_some(), width >= NOTED);
        width
    }

    /// Two slabs seen at 60 and 75 degrees are 6.2 and 10.6 % too dark.
    #[test]
    fn luminance_behind_panes_has_the_error_of_lost_polarization() {
        for (degrees, exact, faces) in
            [(0.0f32, 1.0, 1.0), (60.0, 0.7656, 0.7185), (75.0, 0.4749, 0.4246)]
        {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let meter = Meter::radiance(Vec3::ZERO, Vec3::new(sin, 0.0, cos), 0.0).unwrap();
            let own = wider(&scene(true, Vec3::NEG_Z), MeterKind::Radiance, meter);
            assert!((own - (exact / faces - 1.0)).abs() < 1e-3, "{degrees}: {own}");
        }
    }

    #[test]
    fn straight_light_has_only_the_error_of_light_between_panes() {
        let meter = Meter::irradiance(Vec3::ZERO, Vec3::Z).unwrap();
        let toward = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Vec3::new(-sin, 0.0, -cos)
        };
        let at = |degrees: f32| wider(&scene(false, toward(degrees)), MeterKind::Irradiance, meter);
        assert!(at(0.0) < 1e-4 && (0.005..0.015).contains(&at(60.0)), "{}", at(60.0));
        assert!((0.01..0.025).contains(&at(75.0)), "{}", at(75.0));
    }
}
