//! Dispersion: refractive indices as functions of the wavelength.

use crate::error::{Error, Result};
use crate::glasses;
use crate::spectrum::Wavelength;
use serde::Serialize;

/// Wavelengths of the Fraunhofer lines F, d and C, nm: glass catalogs give indices there.
pub const LINES: [f64; 3] = [486.1327, 587.5618, 656.2725];

/// Refractive index of a clear medium over that of air, as a function of the wavelength in air.
#[derive(Clone, Debug, PartialEq)]
pub enum RefractiveIndex {
    /// One index for all wavelengths.
    Constant(f64),
    /// A medium of the catalog, by its index there.
    Glass(usize),
    /// Cauchy's equation `A + B/l^2 + C/l^4` with `l` in micrometers.
    Cauchy([f64; 3]),
    /// Sellmeier's equation `n^2 = 1 + sum B l^2/(l^2 - C)` with `l` in micrometers: pairs of `B`
    /// and `C`.
    Sellmeier(Vec<[f64; 2]>),
    /// Index at the line d and Abbe number `(n_d - 1)/(n_F - n_C)`, as Cauchy's equation with
    /// `C = 0`.
    Abbe {
        /// Index at 587.56 nm.
        index: f64,
        /// Abbe number.
        abbe: f64,
    },
    /// Wavelengths, nm, in ascending order with the indices there: linear in between, constant
    /// outside.
    Table(Vec<[f64; 2]>),
}

impl RefractiveIndex {
    /// Bounds of indices at all wavelengths.
    pub const BOUNDS: [f64; 2] = [0.1, 10.0];

    /// The medium of this name in the catalog; upper and lower case are equal.
    pub fn named(name: &str) -> Option<Self> {
        glasses::position(name).map(Self::Glass)
    }

    /// An index by samples: wavelengths, nm, and the indices there.
    ///
    /// # Errors
    /// If there are no samples, if their numbers differ or if the wavelengths do not grow.
    pub fn of_samples(nanometers: Vec<f64>, values: Vec<f64>) -> Result<Self> {
        if nanometers.is_empty() || nanometers.len() != values.len() {
            let problem = format!(
                "the refractive index has {} values at {} wavelengths",
                values.len(),
                nanometers.len()
            );
            return Err(Error::new(problem, "give one value for each wavelength"));
        }
        if let Some(wrong) = nanometers.iter().find(|nm| !(nm.is_finite() && **nm > 0.0)) {
            let problem = format!("a wavelength of the refractive index is {wrong}");
            return Err(Error::new(problem, "give nanometers above 0"));
        }
        if nanometers.windows(2).any(|pair| pair[0] >= pair[1]) {
            let problem = "the wavelengths of the refractive index do not grow";
            return Err(Error::new(problem, "sort them, and the values with them"));
        }
        let index = Self::Table(nanometers.into_iter().zip(values).map(<[f64; 2]>::from).collect());
        index.checked()
    }

    /// The index, if it is finite and within [`Self::BOUNDS`] at all visible wavelengths.
    ///
    /// # Errors
    /// If it is not.
    pub fn checked(self) -> Result<Self> {
        let [low, high] = Self::BOUNDS;
        let wrong = [LINES[1]].into_iter().chain(Wavelength::all().map(Wavelength::nanometers));
        match wrong.map(|nm| (nm, self.at(nm))).find(|(_, at)| !(low..=high).contains(at)) {
            None => Ok(self),
            Some((nm, at)) => {
                let problem = match self {
                    Self::Constant(_) => "the refractive index is out of range".to_owned(),
                    _ => format!("the refractive index is {at} at {nm:.0} nm, out of range"),
                };
                Err(Error::new(problem, "give a number from 0.1 to 10, such as 1.5 for glass"))
            }
        }
    }

    /// Names of the media in the catalog.
    pub fn names() -> impl Iterator<Item = &'static str> {
        glasses::CATALOG.iter().map(|glass| glass.name)
    }

    /// Name in the catalog.
    pub fn name(&self) -> Option<&'static str> {
        match self {
            Self::Glass(index) => Some(glasses::CATALOG[*index].name),
            _ => None,
        }
    }

    /// The index at a wavelength in nm. theory.md (47j)
    #[inline]
    pub fn at(&self, nanometers: f64) -> f64 {
        let l2 = (nanometers / 1000.0).powi(2);
        match self {
            Self::Constant(index) => *index,
            Self::Glass(index) => sellmeier(glasses::CATALOG[*index].terms, l2),
            Self::Cauchy([a, b, c]) => a + b / l2 + c / (l2 * l2),
            Self::Sellmeier(terms) => sellmeier(terms, l2),
            Self::Abbe { index, abbe } => {
                let inverse = |line: f64| (line / 1000.0).powi(-2);
                let [f, d, c] = LINES.map(inverse);
                index + (index - 1.0) / (abbe * (f - c)) * (l2.recip() - d)
            }
            Self::Table(rows) => {
                let after = rows.partition_point(|row| row[0] <= nanometers);
                let high = rows[after.min(rows.len() - 1)];
                let low = rows[after.saturating_sub(1)];
                if high[0] > low[0] {
                    low[1] + (nanometers - low[0]) / (high[0] - low[0]) * (high[1] - low[1])
                } else {
                    low[1]
                }
            }
        }
    }

    /// The index at the line d, 587.56 nm: the single number of media.
    #[inline]
    pub fn at_d(&self) -> f64 {
        self.at(LINES[1])
    }

    /// Abbe number `(n_d - 1)/(n_F - n_C)`; infinite without dispersion.
    pub fn abbe(&self) -> f64 {
        let [f, d, c] = LINES.map(|line| self.at(line));
        (d - 1.0) / (f - c)
    }

    /// Returns true if the index depends on the wavelength.
    pub fn is_dispersive(&self) -> bool {
        let first = self.at_d();
        Wavelength::all().any(|wavelength| self.at(wavelength.nanometers()) != first)
    }
}

#[inline]
fn sellmeier(terms: &[[f64; 2]], l2: f64) -> f64 {
    (1.0 + terms.iter().map(|[b, c]| b * l2 / (l2 - c)).sum::<f64>()).sqrt()
}

/// The media on both sides of a dispersive interface, and the index behind it over that in front.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Dispersion {
    #[serde(skip)]
    inside: RefractiveIndex,
    #[serde(skip)]
    outside: RefractiveIndex,
    /// For each wavelength.
    relative: Vec<f32>,
}

impl Dispersion {
    /// The interface of these media; `None` unless one of them is dispersive.
    pub fn new(inside: RefractiveIndex, outside: RefractiveIndex) -> Option<Self> {
        let relative = |wavelength: Wavelength| {
            let at = wavelength.nanometers();
            (inside.at(at) / outside.at(at)) as f32
        };
        let is_dispersive = inside.is_dispersive() || outside.is_dispersive();
        let relative = Wavelength::all().map(relative).collect();
        is_dispersive.then_some(Self { inside, outside, relative })
    }

    /// Medium behind the interface.
    #[inline]
    pub fn inside(&self) -> &RefractiveIndex {
        &self.inside
    }

    /// Medium in front of the interface.
    #[inline]
    pub fn outside(&self) -> &RefractiveIndex {
        &self.outside
    }

    /// Index behind the interface over that in front, for one wavelength.
    #[inline]
    pub fn relative(&self, wavelength: Wavelength) -> f32 {
        self.relative[wavelength.index() as usize - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_match_published_values_at_the_lines_f_d_and_c() {
        // Schott's data sheets; for the others refractiveindex.info, from the equations of the same
        // sources.
        for (name, lines, tolerance) in [
            ("N-BK7", [1.52238, 1.51680, 1.51432], 5e-6),
            ("F2", [1.63208, 1.62004, 1.61503], 5e-6),
            ("SF11", [1.80645, 1.78472, 1.77599], 1e-5),
            ("N-SF11", [1.80651, 1.78472, 1.77596], 1e-5),
            ("LASF9", [1.86898, 1.85025, 1.84255], 1e-5),
            ("N-BAF10", [1.68000, 1.67003, 1.66578], 1e-5),
            ("N-FK51A", [1.49056, 1.48656, 1.48480], 1e-5),
            ("SF5", [1.68750, 1.67270, 1.66661], 1e-5),
            ("SF10", [1.74648, 1.72825, 1.72085], 1e-5),
            ("fused silica", [1.46313, 1.45846, 1.45637], 1e-5),
            ("water", [1.33712, 1.33336, 1.33150], 5e-4),
            ("sapphire", [1.77555, 1.76823, 1.76494], 1e-4),
            ("diamond", [2.4354, 2.4175, 2.4099], 2e-4),
        ] {
            let medium = RefractiveIndex::named(name).unwrap();
            for (line, expected) in LINES.into_iter().zip(lines) {
                let index = medium.at(line);
                assert!((index - expected).abs() <= tolerance, "{name} {line}: {index} {expected}");
            }
        }
        let abbe = |name: &str| RefractiveIndex::named(name).unwrap().abbe();
        assert!((abbe("n-bk7") - 64.17).abs() < 0.01, "{}", abbe("N-BK7"));
        assert!((abbe("f2") - 36.37).abs() < 0.01, "{}", abbe("F2"));
    }

    #[test]
    fn abbe_number_gives_the_index_and_dispersion_at_the_lines() {
        let medium = RefractiveIndex::Abbe { index: 1.5168, abbe: 64.17 };
        assert!((medium.at_d() - 1.5168).abs() < 1e-12);
        assert!((medium.abbe() - 64.17).abs() < 1e-9);
        let bk7 = RefractiveIndex::named("N-BK7").unwrap();
        for nanometers in [450.0, 500.0, 550.0, 600.0, 700.0] {
            assert!((medium.at(nanometers) - bk7.at(nanometers)).abs() < 1.5e-3, "{nanometers}");
        }
    }

    #[test]
    fn tables_are_linear_inside_and_constant_outside() {
        let medium = RefractiveIndex::Table(vec![[400.0, 1.6], [600.0, 1.5], [700.0, 1.49]]);
        for (nanometers, expected) in
            [(380.0, 1.6), (400.0, 1.6), (500.0, 1.55), (600.0, 1.5), (700.0, 1.49), (780.0, 1.49)]
        {
            assert!((medium.at(nanometers) - expected).abs() < 1e-12, "{nanometers}");
        }
        assert_eq!(RefractiveIndex::Table(vec![[500.0, 1.7]]).at(400.0), 1.7);
    }

    #[test]
    fn interfaces_of_constant_media_have_no_dispersion() {
        let constant = |index| RefractiveIndex::Constant(index);
        assert_eq!(Dispersion::new(constant(1.5), constant(1.0)), None);
        let water = RefractiveIndex::named("water").unwrap();
        let glass = RefractiveIndex::named("N-BK7").unwrap();
        let interface = Dispersion::new(glass.clone(), water.clone()).unwrap();
        for wavelength in Wavelength::all().step_by(100) {
            let at = wavelength.nanometers();
            let expected = (glass.at(at) / water.at(at)) as f32;
            assert_eq!(interface.relative(wavelength), expected);
        }
    }
}
