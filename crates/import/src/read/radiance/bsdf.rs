//! `BSDF` and `aBSDF`: sheets that scatter by the matrices of a file.

use super::materials::Definition;
use super::tokens::Primitive;
use crate::look::Look;
use crate::read::klems::{self, EvenShares};
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::luminance;
use bdpm_core::scene::bsdf::{Bsdf, Klems};
use glam::{DAffine3, DVec3, Vec3};
use std::path::{Path, PathBuf};

/// Folders above that of a scene file in which a BSDF file is looked for.
const FOLDERS_ABOVE: usize = 4;

/// The arguments of such a material.
struct Arguments<'a> {
    file: &'a str,
    up: DVec3,
    /// Distance to the geometry that the sheet stands for.
    thickness: f64,
    /// Whether words follow that turn the sheet.
    is_turned: bool,
}

impl<'a> Arguments<'a> {
    /// The words of a primitive.
    fn new(own: &'a Primitive) -> Result<Self> {
        let first = usize::from(own.kind == "BSDF");
        let number = |index: usize| own.words.get(index).and_then(|word| word.parse::<f64>().ok());
        let up = [first + 1, first + 2, first + 3].map(number);
        let thickness = if first == 1 { number(0) } else { Some(0.0) };
        match (own.words.get(first), up, thickness) {
            (Some(file), [Some(x), Some(y), Some(z)], Some(thickness)) => {
                let is_turned = own.words.len() > first + 5;
                Ok(Self { file, up: DVec3::new(x, y, z), thickness, is_turned })
            }
            _ => {
                let advice = "give the file and three numbers, the direction that is up";
                Err(own.error("has no file with a direction", advice))
            }
        }
    }
}

/// The look of a material of these kinds. Sheets whose file cannot be read are gray.
///
/// # Errors
/// If there is no such file, or its arguments are not as they should be.
pub(super) fn look(own: &Definition, warnings: &mut GroupedWarnings) -> Result<Look> {
    let Definition { primitive, file, map, .. } = own;
    let arguments = Arguments::new(primitive)?;
    let path = find(file, arguments.file)?;
    let name = &primitive.name;
    if arguments.thickness != 0.0 {
        warnings
            .skipped("a sheet without thickness, before the geometry that it stands for, of", name);
    }
    if arguments.is_turned {
        warnings.skipped("ignored the transform of the BSDF of", name);
    }
    let matrices = match klems::read(&path, even(primitive)) {
        Ok(matrices) => matrices,
        Err(error) => {
            let problem = error.problem();
            warnings.skipped(format!("diffuse gray of .5, since {problem}, for"), name);
            return Ok(Look::gray());
        }
    };
    if primitive.kind == "aBSDF" {
        warnings
            .skipped("light that passes straight is spread over a patch of directions by", name);
    }
    Ok(Look::new(Bsdf::Klems(Klems::new(matrices, up(arguments.up, map)))))
}

/// The direction that is up in the scene.
fn up(up: DVec3, map: &DAffine3) -> Vec3 {
    map.transform_vector3(up).normalize_or(DVec3::Z).as_vec3()
}

/// The numbers: diffuse reflection of the front and of the back, and transmission, which the file
/// does not have.
fn even(own: &Primitive) -> EvenShares {
    let share = |index: usize| {
        let rgb = own.numbers.get(3 * index..3 * index + 3);
        let share = |rgb: &[f64]| luminance(Vec3::new(rgb[0] as f32, rgb[1] as f32, rgb[2] as f32));
        rgb.map_or(0.0, share).clamp(0.0, 1.0)
    };
    EvenShares { front: share(0), back: share(1), transmitted: share(2) }
}

/// The file of a name beside a scene file, in folders above it, or in the working directory.
fn find(scene: &Path, name: &str) -> Result<PathBuf> {
    let above = scene.ancestors().skip(1).take(1 + FOLDERS_ABOVE);
    let mut places = above.map(|folder| folder.join(name)).chain([PathBuf::from(name)]);
    places.find(|place| place.is_file()).ok_or_else(|| {
        let advice = "check the name; it is relative to the folder of the scene file, to one above it, \
                      or to the working directory";
        Error::new(format!("there is no BSDF file `{name}`"), advice)
    })
}
