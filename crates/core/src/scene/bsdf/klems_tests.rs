use super::*;
use crate::base::math::uniform_sphere;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::bsdf::DiffuseTransmission;

fn quarter() -> AngleBasis {
    AngleBasis::named("LBNL/Klems Quarter").unwrap()
}

/// Values by the patches of the columns and of the rows.
fn filled(basis: &AngleBasis, value: impl Fn(usize, usize) -> f32) -> Option<Vec<f32>> {
    let patches = basis.patches();
    Some((0..patches * patches).map(|index| value(index % patches, index / patches)).collect())
}

/// Reflects and transmits unlike shares of each direction, reciprocally.
fn uneven() -> Klems {
    let basis = quarter();
    let symmetric = |scale: f32| {
        filled(&basis, |from, to| {
            let [a, b] = [basis.opposite(from), to].map(|patch| (patch * patch % 7) as f32 + 0.1);
            scale * a * b
        })
    };
    let values = [[symmetric(2e-3), symmetric(8e-3)], [symmetric(5e-3), None]];
    Klems::new(KlemsMatrices::new(basis.clone(), values).unwrap().shared(), Vec3::Y)
}

fn seen(wo: Vec3) -> Vertex {
    let front = wo.z > 0.0;
    Vertex { normal: if front { Vec3::Z } else { -Vec3::Z }, wo, front, tangent: None }
}

#[test]
fn patches_cover_the_hemisphere() {
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    for (name, count) in [("Full", 145), ("Half", 73), ("Quarter", 41)] {
        let basis = AngleBasis::named(&format!("LBNL/Klems {name}")).unwrap();
        assert_eq!(basis.patches(), count);
        let sum: f32 = (0..count).map(|patch| basis.projected(patch)).sum();
        assert!((sum - PI).abs() < 1e-5, "{sum}");
        for patch in 0..count {
            let w = basis.direction(patch, rng.next_2d());
            assert_eq!(basis.patch(w), patch, "{w}");
            assert_eq!(basis.patch(-w), basis.opposite(patch), "{w}");
        }
    }
    // The first patch of a band is centered on x, the next ones turn toward y.
    let basis = quarter();
    assert_eq!(
        [Vec3::Z, Vec3::new(0.4, 0.0, 0.9), Vec3::new(0.28, 0.28, 0.9)]
            .map(|w| { basis.patch(w.normalize()) }),
        [0, 1, 2]
    );
    let bands = |bands: &[(f32, usize)]| {
        let band = |&(upper_deg, patches)| AngleBand { upper_deg, patches };
        AngleBasis::new(bands.iter().map(band).collect())
    };
    assert!(bands(&[(30.0, 1), (90.0, 4)]).is_some());
    for wrong in [
        &[(30.0, 3), (90.0, 4)][..],
        &[(90.0, 1), (30.0, 4)],
        &[(80.0, 1)],
        &[],
        &[(90.0, usize::MAX)],
    ] {
        assert!(bands(wrong).is_none(), "{wrong:?}");
    }
}

#[test]
fn even_matrices_are_a_sheet_that_transmits_diffusely() {
    let basis = AngleBasis::named("LBNL/Klems Full").unwrap();
    let even = |share: f32| filled(&basis, |_, _| share / PI);
    let [reflected, transmitted] = [0.5, 0.2];
    let values = [[even(reflected), even(transmitted)], [even(reflected), None]];
    let sheet = Klems::new(KlemsMatrices::new(basis.clone(), values).unwrap().shared(), Vec3::Y);
    let expected = DiffuseTransmission::new(Rgb::splat(reflected), Rgb::splat(transmitted));
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    for _ in 0..1000 {
        let [wo, wi] = [0; 2].map(|_| uniform_sphere(rng.next_2d()));
        let at = seen(wo);
        let cos = wi.dot(at.normal);
        assert!((sheet.eval(&at, wi) - expected.eval(cos)).abs().max_element() < 1e-6);
        let [own, other] = [sheet.pdf_w(&at, wi), expected.pdf_w(cos)];
        assert!((own / other - 1.0).abs() < 1e-3, "{own} {other}");
        let sample = sheet.sample(&at, Transport::Flux, &mut rng).unwrap();
        assert!((sample.weight.x - 0.7).abs() < 1e-3, "{}", sample.weight);
    }
    for front in [true, false] {
        let shares = sheet.diffuse_shares(front);
        assert!((shares[0] - reflected).abs() + (shares[1] - transmitted).abs() < 1e-5);
    }
}

/// The diagonal of a transmission is light that goes straight on, that of a reflection a mirror.
#[test]
fn the_diagonal_is_straight_on() {
    let basis = quarter();
    let diagonal = |share: f32| {
        filled(&basis, |from, to| if from == to { share / basis.projected(to) } else { 0.0 })
    };
    let values = [[None, diagonal(0.8)], [diagonal(0.3), diagonal(0.7)]];
    let matrices = KlemsMatrices::new(basis.clone(), values).unwrap().shared();
    let sheet = Klems::new(matrices, Vec3::Y);
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    for _ in 0..1000 {
        let wo = uniform_sphere(rng.next_2d());
        let at = seen(wo);
        let sample = sheet.sample(&at, Transport::Flux, &mut rng).unwrap();
        let transmits = sample.wi.z * wo.z < 0.0;
        let straight = if transmits { -wo } else { Vec3::new(-wo.x, -wo.y, wo.z) };
        assert_eq!(basis.patch(sample.wi), basis.patch(straight));
        assert!(transmits || wo.z < 0.0, "the front does not reflect");
    }
    assert!((matrices.scattered(true, 7) - 0.8).abs() < 1e-5);
    assert!((matrices.scattered(false, 7) - 1.0).abs() < 1e-5);
}

/// Light from high behind leaves upward on the front, for any turn of the sheet.
#[test]
fn redirected_light_goes_up() {
    let basis = AngleBasis::named("LBNL/Klems Full").unwrap();
    let toward = |y: f32| basis.patch(Vec3::new(0.0, y, 1.0).normalize());
    // The sun stands behind and above: going straight on, its light would go down.
    let (column, row) = (toward(-1.0), toward(0.5));
    let only =
        filled(
            &basis,
            |from, to| {
                if (from, to) == (column, row) { 0.9 / basis.projected(to) } else { 0.0 }
            },
        );
    let matrices = KlemsMatrices::new(basis.clone(), [[None, None], [None, only]]).unwrap();
    let sheet = Klems::new(matrices.shared(), Vec3::Z);
    for front in [Vec3::X, -Vec3::X, Vec3::new(0.6, 0.8, 0.0)] {
        let sun = (Vec3::Z - front).normalize();
        let at = Vertex { normal: -front, wo: sun, front: false, tangent: None };
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        let sample = sheet.sample(&at, Transport::Flux, &mut rng).unwrap();
        assert!(sample.wi.dot(front) > 0.7 && sample.wi.z > 0.3, "{}", sample.wi);
        assert!((sample.weight.x - 0.9).abs() < 1e-3, "{}", sample.weight);
        // A camera on the front that looks down at it sees the sun.
        let camera = Vertex { normal: front, wo: sample.wi, front: true, tangent: None };
        let value = 0.9 / basis.projected(row);
        assert_eq!(sheet.eval(&camera, sun), Rgb::splat(value));
        assert_eq!(sheet.eval(&camera, -sun), Rgb::ZERO);
    }
}

/// Sampling, its density and the value agree for both quantities.
#[test]
fn samples_have_their_density_and_carry_the_scattered_share() {
    let sheet = uneven();
    let (basis, patches) = (sheet.matrices.basis(), sheet.matrices.basis().patches());
    let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
    for wo in [Vec3::new(0.3, -0.2, 0.9), Vec3::new(-0.8, 0.5, 0.3), Vec3::new(0.1, 0.7, -0.5)] {
        let at = seen(wo.normalize());
        let column = basis.opposite(basis.patch(at.wo));
        let share = sheet.matrices.scattered(at.front, column);
        for transport in [Transport::Radiance, Transport::Flux] {
            let n = 40_000;
            let (mut mean, mut square, mut own) = (0.0, 0.0, vec![0u32; patches]);
            for _ in 0..n {
                let sample = sheet.sample(&at, transport, &mut rng).unwrap();
                let weight = f64::from(sample.weight.x);
                mean += weight / f64::from(n);
                square += weight * weight / f64::from(n);
                let density = sheet.pdf_w(&at, sample.wi);
                let expected = sheet.eval(&at, sample.wi).x * sample.wi.z.abs() / density;
                if transport == Transport::Radiance {
                    assert!((sample.weight.x / expected - 1.0).abs() < 1e-3);
                }
                if sample.wi.dot(at.normal) > 0.0 {
                    own[basis.patch(sample.wi)] += 1;
                }
            }
            let error = ((square - mean * mean) / f64::from(n)).max(0.0).sqrt();
            if transport == Transport::Flux {
                assert!((mean - f64::from(share)).abs() < 4.0 * error + 1e-5, "{mean} {share}");
            }
            for (patch, count) in own.iter().enumerate() {
                let prob = sheet.matrices.prob(sheet.place(at.wo), (at.front, patch));
                let (mean, off) = (prob * n as f32, *count as f32 - prob * n as f32);
                assert!(off.abs() < 5.0 * mean.sqrt() + 1.0, "{patch}: {count} {mean}");
            }
        }
    }
}

#[test]
fn a_missing_transmission_is_that_of_the_other_side_in_reverse() {
    let sheet = uneven();
    let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
    for _ in 0..1000 {
        let [wo, wi] = [0; 2].map(|_| uniform_sphere(rng.next_2d()));
        let [forth, back] = [(wo, wi), (wi, wo)].map(|(wo, wi)| sheet.eval(&seen(wo), wi).x);
        assert!((forth - back).abs() <= 1e-5 * forth, "{forth} {back}");
        let [forth, back] = [(wo, wi), (wi, wo)].map(|(wo, wi)| sheet.pdf_w(&seen(wo), wi));
        assert!((forth > 0.0) == (back > 0.0));
    }
    // Nothing else than a matrix of each pair of patches that scatters at most all light.
    let new = |values: Option<Vec<f32>>| {
        KlemsMatrices::new(quarter(), [[None, values], [None, None]]).map(|_| ())
    };
    assert!(new(None).is_err() && new(Some(vec![0.0; 41])).is_err());
    assert!(new(filled(&quarter(), |_, _| 0.4)).unwrap_err().contains("1.25"));
    assert!(new(filled(&quarter(), |_, _| f32::NAN)).is_err());
}
