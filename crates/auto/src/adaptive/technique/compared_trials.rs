//! Compares the trial of a technique with that of path tracing: theory.md, section 22b.

use super::trial::Trial;

/// Standard errors by which two trials must differ.
const SIGNIFICANT: f64 = 4.0;

/// Factor on the squared bias that a technique is known to have at the radii of the trial.
const KNOWN_BIAS: f64 = 4.0;

/// Smallest relative difference that refutes a technique.
const LEAST_DIFFERENCE: f64 = 0.05;

/// Number of independent parts of the noise of photons, which the pixels share.
const PARTS: f64 = 4.0;

/// Number of hits that path tracing must expect of light that it does not find.
const MIN_HITS: f64 = 10.0;

/// Luminance of a pixel, over that of others and the mean of all, from which on it is a hit by
/// chance.
const FAR_ABOVE: f64 = 4.0;

/// Share of the light in such hits from which on a trial says nothing about its noise.
const LUCKY_SHARE: f64 = 0.2;

/// Whether much of the light of path tracing is far above the mean of the other techniques in its
/// pixels: it hit a lamp by chance. theory.md, section 22a
pub fn is_lucky(path: &[f64], others: &[Vec<f64>]) -> bool {
    if others.is_empty() {
        return false;
    }
    let around =
        |pixel: usize| others.iter().map(|other| other[pixel]).sum::<f64>() / others.len() as f64;
    let around: Vec<f64> = (0..path.len()).map(around).collect();
    let mean = around.iter().sum::<f64>() / path.len() as f64;
    let above = |(own, around): (&f64, &f64)| (own - FAR_ABOVE * (around + mean)).max(0.0);
    let above: f64 = path.iter().zip(&around).map(above).sum();
    above > LUCKY_SHARE * path.iter().sum::<f64>()
}

/// Whether the mean of a trial disagrees with that of path tracing, beyond noise and the squared
/// relative bias `bias2`. No path is likely to find more than the luminance `brightest`. theory.md
/// (98g)
pub fn disagrees(trial: &Trial, path: &Trial, weights: &[f64], known: (f64, f64)) -> bool {
    let values = |of: &Trial| -> Vec<[f64; 2]> {
        let iterations = of.noise.iterations as f64;
        let pixels = of.noise.pixels.iter();
        pixels.map(|pixel| [pixel.luminance, pixel.noise.sampled / iterations]).collect()
    };
    let paths = path.noise.iterations as f64 * f64::from(path.noise.camera_paths);
    is_different([&values(trial), &values(path)], weights, paths, known)
}

/// Whether two images differ. Both have a luminance and its variance for each pixel, and the second
/// has this number of camera paths in each pixel.
fn is_different(
    [image, path]: [&[[f64; 2]]; 2],
    weights: &[f64],
    paths: f64,
    (bias2, brightest): (f64, f64),
) -> bool {
    let count = weights.len() as f64;
    let (mut square, mut variance, mut own_noise, mut excess) = (0.0, 0.0, 0.0, 0.0);
    for ((own, other), weight) in image.iter().zip(path).zip(weights) {
        let difference = own[0] - other[0];
        let noise = own[1] + other[1];
        square += weight * (difference * difference - noise);
        // The square of a normal variable has twice the squared variance.
        variance += 2.0 * (weight * noise).powi(2);
        own_noise += weight * own[1];
        excess += difference;
    }
    let error = (variance / (count * count) + (own_noise / count).powi(2) / PARTS).sqrt();
    let is_found = excess <= 0.0 || excess * paths > MIN_HITS * brightest;
    let least = (KNOWN_BIAS * bias2).max(LEAST_DIFFERENCE.powi(2));
    is_found && square / count - SIGNIFICANT * error > least
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};
    use bdpm_core::film::radiance::luminance_weights;

    const PIXELS: usize = 2000;

    /// An image of luminance `mean` whose noise has this relative deviation.
    fn image(run: u64, mean: f64, noise: f64) -> Vec<[f64; 2]> {
        let mut rng = StreamKey::new(run, Stream::Test, 3).rng(0);
        let mut normal = || {
            let [u, v] = rng.next_2d().map(f64::from);
            (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        };
        (0..PIXELS).map(|_| [mean + noise * normal(), noise * noise]).collect()
    }

    /// In a dark image a lamp behind glass is hit by few camera paths. Weights by an image that
    /// shows these hits would call the light of photons a leak.
    #[test]
    fn rare_hits_of_path_tracing_refute_nothing() {
        let (paths, hit, light) = (400.0, 4000.0, 0.1);
        let mut rng = StreamKey::new(3, Stream::Test, 4).rng(0);
        let hits_of_pixel = light * paths / hit;
        let mut refuted_by_mean = 0;
        for run in 0..20 {
            let mut path = vec![[0.0; 2]; PIXELS];
            for [value, variance] in &mut path {
                if f64::from(rng.next_1d()) < hits_of_pixel {
                    (*value, *variance) = (hit / paths, (hit / paths).powi(2));
                }
            }
            let photons = image(run, light, 0.03);
            let both = photons.iter().zip(&path);
            let mean: Vec<f64> = both.map(|(own, other)| 0.5 * (own[0] + other[0])).collect();
            let own: Vec<f64> = photons.iter().map(|own| own[0]).collect();
            let refutes = |by: &[f64]| {
                let weights = luminance_weights(by);
                is_different([&photons, &path], &weights, paths, (1e-3, hit))
            };
            assert!(!refutes(&own));
            refuted_by_mean += u32::from(refutes(&mean));
        }
        assert!(refuted_by_mean > 4, "{refuted_by_mean}");
    }

    /// A lamp behind waves that a few pixels hit, and the noise of path tracing in a room.
    #[test]
    fn few_hits_with_much_of_the_light_are_luck_and_noise_is_none() {
        let luminances = |own: Vec<[f64; 2]>| own.iter().map(|[own, _]| *own).collect::<Vec<f64>>();
        let others: Vec<Vec<f64>> = (1..4).map(|run| luminances(image(run, 0.1, 0.03))).collect();
        let mut hits = vec![0.05; PIXELS];
        (0..5).for_each(|hit| hits[400 * hit] = 20.0);
        assert!(is_lucky(&hits, &others));
        assert!(!is_lucky(&hits, &[]), "nothing else is known");
        assert!(!is_lucky(&luminances(image(5, 0.1, 0.1)), &others), "noise");
        // A caustic that the others see, too
        let mut caustic = others.clone();
        caustic.iter_mut().for_each(|own| own[..20].fill(20.0));
        assert!(!is_lucky(&caustic[0], &caustic[1..]));
    }

    #[test]
    fn only_leaks_beyond_noise_and_known_bias_refute() {
        let weights = vec![1.0; PIXELS];
        let path = image(1, 1.0, 0.3);
        let of =
            |mean: f64, known| is_different([&image(2, mean, 0.1), &path], &weights, 64.0, known);
        assert!(!of(1.0, (0.0, 1.0)), "no difference");
        assert!(of(1.3, (1e-3, 1.0)) && of(0.7, (1e-3, 1.0)));
        assert!(!of(1.3, (0.03, 1.0)), "the bias is known");
        // 2000 pixels with 64 paths and an excess of .3: 38,400.
        assert!(of(1.3, (1e-3, 3000.0)) && !of(1.3, (1e-3, 5000.0)));
        assert!(of(0.7, (1e-3, 5000.0)), "light that path tracing finds is there");
    }
}
