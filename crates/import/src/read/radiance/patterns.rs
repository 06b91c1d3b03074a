//! Distributions of luminaires as patterns: `brightdata` and `colordata` with functions and angles
//! of `source.cal`.

use super::data::DataFile;
use super::materials::Definition;
use super::tokens::Primitive;
use super::transforms::Transforms;
use bdpm_core::base::error::Result;
use glam::{DAffine3, DMat3, DVec3};
use std::rc::Rc;

/// A factor of the radiance.
pub struct Pattern {
    /// For each channel, or one for all.
    pub data: Vec<Rc<DataFile>>,
    pub coordinates: Vec<(Coordinate, f64)>,
    pub correction: Correction,
    multiplier: f64,
    /// To the frame in which the angles are, and unit vectors of this frame.
    to_frame: DMat3,
    pub frame: DMat3,
    /// What the distribution depends on, for the cache.
    pub key: String,
}

/// A coordinate of `source.cal`, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coordinate {
    Theta,
    /// Azimuth, folded at this angle.
    Phi(f64),
    /// Angles of type B, possibly without their sign.
    Vertical(bool),
    Horizontal(bool),
}

/// A function of `source.cal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correction {
    /// The data are radiances.
    None,
    /// The data are intensities of a flat surface.
    Flat,
    /// The data are intensities of a box of this size.
    Box([f64; 3]),
    /// The data are intensities of an upright cylinder of this diameter and height.
    Cylinder([f64; 2]),
}

impl Coordinate {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "src_theta" => Self::Theta,
            "src_phi" => Self::Phi(360.0),
            "src_phi2" => Self::Phi(180.0),
            "src_phi4" => Self::Phi(90.0),
            "srcB_vert" => Self::Vertical(true),
            "srcB_vert2" => Self::Vertical(false),
            "srcB_horiz" => Self::Horizontal(true),
            "srcB_horiz2" => Self::Horizontal(false),
            _ => return None,
        })
    }

    /// The coordinate of a unit direction of emission.
    fn at(self, to: DVec3) -> f64 {
        let signed = |angle: f64, is_signed: bool| if is_signed { angle } else { angle.abs() };
        match self {
            Self::Theta => (-to.z).clamp(-1.0, 1.0).acos().to_degrees(),
            Self::Phi(fold) => {
                let phi = to.y.atan2(to.x).to_degrees().rem_euclid(360.0);
                let waves = ((phi + fold) / (2.0 * fold)).floor();
                if fold < 360.0 { (phi - 2.0 * fold * waves).abs() } else { phi }
            }
            Self::Vertical(is_signed) => signed(to.x.atan2(-to.z).to_degrees(), is_signed),
            Self::Horizontal(is_signed) => signed((-to.y).atan2(-to.z).to_degrees(), is_signed),
        }
    }
}

/// A coordinate with a constant that is added: `src_phi2+90`.
fn coordinate(word: &str) -> Option<(Coordinate, f64)> {
    let split = word.find(['+', '-']).unwrap_or(word.len());
    let offset = if split < word.len() { word[split..].parse().ok()? } else { 0.0 };
    Some((Coordinate::of(&word[..split])?, offset))
}

/// Whether a pattern is a distribution that is read: `brightdata` or `colordata` with functions and
/// coordinates of `source.cal`.
pub fn is_distribution(own: &Primitive) -> bool {
    let Some((functions, data)) = names_of(own) else { return false };
    let functions_known = functions.iter().all(|name| *name == functions[0])
        && matches!(&functions[0][..], "corr" | "flatcorr" | "boxcorr" | "lboxcorr" | "cylcorr");
    let at = functions.len() + data.len();
    functions_known
        && own.words[at].ends_with("source.cal")
        && own.words.get(at + 1).is_some_and(|word| coordinate(word).is_some())
}

/// Names of the functions and of the data files.
fn names_of(own: &Primitive) -> Option<(&[String], &[String])> {
    let channels = match &own.kind[..] {
        "brightdata" => 1,
        "colordata" => 3,
        _ => return None,
    };
    let is_long_enough = own.words.len() > 2 * channels;
    is_long_enough.then(|| (&own.words[..channels], &own.words[channels..2 * channels]))
}

/// The transform at the end of the words of a pattern.
fn transform(own: &Primitive, words: &[String]) -> Result<DAffine3> {
    let (transforms, other) = Transforms::of(words)?;
    match (other, &transforms.placements()?[..]) {
        (None, [map]) => Ok(*map),
        (Some(word), _) => {
            Err(own.error(&format!("has the word `{word}` in its transform"), "leave it out"))
        }
        _ => Err(own.error("has an array as its transform", "leave out `-a`")),
    }
}

impl Pattern {
    /// The pattern of a definition, whose data files `read` reads.
    ///
    /// # Errors
    /// If it is malformed.
    pub fn new(
        definition: &Definition,
        mut read: impl FnMut(&str) -> Result<Rc<DataFile>>,
    ) -> Result<Self> {
        let own = &definition.primitive;
        let malformed = |problem: &str| own.error(problem, "write it again with ies2rad");
        let (functions, names) = names_of(own).ok_or_else(|| malformed("has too few words"))?;
        let data: Vec<_> = names.iter().map(|name| read(name)).collect::<Result<_>>()?;
        let dimensions = data[0].axes.len();
        if data.iter().any(|other| other.axes.len() != dimensions) {
            return Err(malformed("has data of different dimensions"));
        }
        let rest = &own.words[2 * functions.len() + 1..];
        let coordinates: Option<Vec<_>> =
            rest.iter().take(dimensions).map(|word| coordinate(word)).collect();
        let coordinates = coordinates.filter(|all| all.len() == dimensions);
        let coordinates =
            coordinates.ok_or_else(|| malformed("has other coordinates than its data"))?;
        let map = definition.map * transform(own, &rest[dimensions..])?;
        let number = |index: usize| own.numbers.get(index).copied().unwrap_or(0.0);
        let correction = match &functions[0][..] {
            "flatcorr" => Correction::Flat,
            "boxcorr" | "lboxcorr" => Correction::Box([number(1), number(2), number(3)]),
            "cylcorr" => Correction::Cylinder([number(1), number(2)]),
            _ => Correction::None,
        };
        let to_frame = map.matrix3.inverse();
        let [z, x] = [DVec3::Z, DVec3::X].map(|axis| (map.matrix3 * axis).normalize_or_zero());
        if !to_frame.is_finite() || z == DVec3::ZERO || x == DVec3::ZERO {
            return Err(malformed("has a transform without an inverse"));
        }
        let frame = DMat3::from_cols(x, z.cross(x), z);
        let mirror = map.matrix3.determinant() < 0.0;
        let key = format!("{:?} {:?} {:?} {mirror}", own.words, own.numbers, definition.file);
        let multiplier = own.numbers.first().copied().unwrap_or(1.0);
        Ok(Self { data, coordinates, correction, multiplier, to_frame, frame, key })
    }

    /// The factor of a channel in a unit direction. That of a flat surface lacks the division by
    /// the cosine.
    pub fn factor(&self, to: DVec3, channel: usize) -> f64 {
        let to = (self.to_frame * to).normalize_or_zero();
        let mut at = [0.0; 2];
        for (own, (coordinate, offset)) in at.iter_mut().zip(&self.coordinates) {
            *own = coordinate.at(to) + offset;
        }
        let data = &self.data[channel.min(self.data.len() - 1)];
        let value = self.multiplier * data.value(&at[..self.coordinates.len()]);
        let [x, y, z] = to.abs().to_array();
        value
            / match self.correction {
                Correction::None | Correction::Flat => 1.0,
                Correction::Box([a, b, c]) => (x * b * c + y * a * c + z * a * b).max(1e-12),
                Correction::Cylinder([width, height]) => {
                    let round = 0.25 * std::f64::consts::PI * width * width;
                    (width * height * (1.0 - z * z).max(0.0).sqrt() + round * z).max(1e-12)
                }
            }
    }
}
