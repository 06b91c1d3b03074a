//! What a measurement rests on: the program and its command, the files with their checksums, the
//! light sources and the surfaces. A report to sign has all of it.

use super::super::page::quoted;
use bdpm::base::error::{Error, Result};
use bdpm::base::input::files_read;
use bdpm::base::math::luminance;
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::measurement::light_groups;
use bdpm::scene::bsdf::{Bsdf, LobeSet, Transport, Vertex};
use bdpm::scene::{LightSource, Scene};
use glam::Vec3;
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Number of light sources beyond which their fluxes are not computed apart: each takes a scene of
/// its own.
const MOST_SOURCES: usize = 256;

/// What a measurement rests on.
pub struct Record {
    /// Coordinated Universal Time.
    pub date: String,
    /// The command line, quoted for a shell.
    pub command: String,
    /// Fingerprint of the scene.
    pub fingerprint: String,
    pub files: Vec<InputFile>,
    pub sources: Vec<SourceFlux>,
    pub surfaces: Vec<SurfaceReflectance>,
}

/// A file that was read.
pub struct InputFile {
    pub path: PathBuf,
    pub bytes: u64,
    pub sha256: String,
}

/// Light sources of one name.
pub struct SourceFlux {
    pub name: String,
    pub count: usize,
    /// Luminous flux of all of them, lm; `None` for an environment, whose flux depends on what it
    /// surrounds, and where there are too many sources.
    pub lumens: Option<f64>,
}

/// A material in use.
pub struct SurfaceReflectance {
    pub name: String,
    pub kind: &'static str,
    /// Share of white light straight on its front that it reflects; `None` if a texture varies it.
    pub reflectance: Option<f32>,
}

impl Record {
    /// What a measurement of this scene rests on, as far as this process has read it.
    ///
    /// # Errors
    /// If a file cannot be read again.
    pub fn new(scene: &Scene) -> Result<Self> {
        let files = files_read().into_iter().filter(|path| path.is_file());
        let arguments: Vec<String> = std::env::args().collect();
        Ok(Self {
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            command: command(&arguments),
            fingerprint: format!("{:016x}", scene.fingerprint()),
            files: files.map(|path| input_file(&path)).collect::<Result<_>>()?,
            sources: sources(scene)?,
            surfaces: surfaces(scene),
        })
    }
}

/// The arguments as a line for a shell, after the name of the program alone.
fn command(arguments: &[String]) -> String {
    let words = arguments.iter().skip(1).map(|word| quoted(word));
    std::iter::once("bdpm".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

fn input_file(path: &Path) -> Result<InputFile> {
    let of_file = |error| Error::io("read", path, error);
    let (mut hash, mut file) = (Sha256::new(), File::open(path).map_err(of_file)?);
    let bytes = io::copy(&mut file, &mut HashWriter(&mut hash)).map_err(of_file)?;
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(InputFile { path: path.to_owned(), bytes, sha256 })
}

/// Hashes what is written.
struct HashWriter<'a>(&'a mut Sha256);

impl io::Write for HashWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Light sources with their fluxes.
fn sources(scene: &Scene) -> Result<Vec<SourceFlux>> {
    let is_short = scene.light_sources().len() <= MOST_SOURCES;
    let flux = |(name, sources): (String, Vec<LightSource>)| {
        let is_around = sources.contains(&LightSource::Environment);
        let lumens = match is_short && !is_around {
            true => {
                let watts = luminance(scene.with_only(&sources)?.lights().power());
                Some(f64::from(watts) * f64::from(LUMENS_PER_WATT))
            }
            false => None,
        };
        Ok(SourceFlux { name, count: sources.len(), lumens })
    };
    light_groups(scene).into_iter().map(flux).collect()
}

/// Materials that a surface of the scene has.
fn surfaces(scene: &Scene) -> Vec<SurfaceReflectance> {
    let used: BTreeSet<usize> =
        scene.placements().iter().map(|own| own.material as usize).collect();
    let of_material = |index: usize| {
        let material = scene.materials().get(index)?;
        Some(SurfaceReflectance {
            name: material.name.clone(),
            kind: kind(&material.bsdf),
            reflectance: (!material.varies()).then(|| reflectance(&material.bsdf)),
        })
    };
    used.into_iter().filter_map(of_material).collect()
}

/// Samples of the reflectance of a surface that has no number of its own.
const SAMPLES: usize = 1 << 16;

/// Share of white light straight on the front that returns to its side. That of most surfaces is a
/// mean over sampled directions, within .002.
fn reflectance(bsdf: &Bsdf) -> f32 {
    match bsdf {
        Bsdf::Lambertian { .. } | Bsdf::Mirror { .. } => return luminance(bsdf.albedo()),
        Bsdf::DiffuseTransmission(sheet) => return luminance(sheet.shares()[0]),
        Bsdf::ThinDielectric(sheet) => return luminance(sheet.shares(1.0)[1]),
        _ => {}
    }
    let at = Vertex { normal: Vec3::Z, wo: Vec3::Z, front: true, tangent: Some(Vec3::X) };
    let mut rng = StreamKey::new(0, Stream::Reflectance, 0).rng(0);
    let sample = |_| {
        let sample = bsdf.sample(&at, Transport::Flux, LobeSet::All, &mut rng)?;
        (sample.wi.z > 0.0).then(|| f64::from(luminance(sample.weight)))
    };
    let sum: f64 = (0..SAMPLES).filter_map(sample).sum();
    (sum / SAMPLES as f64) as f32
}

/// The kind of a surface in words.
fn kind(bsdf: &Bsdf) -> &'static str {
    match bsdf {
        Bsdf::Lambertian { .. } => "diffuse",
        Bsdf::Mirror { .. } => "mirror",
        Bsdf::Dielectric(_) => "glass",
        Bsdf::ThinDielectric(_) => "thin glass",
        Bsdf::Conductor(_) => "metal",
        Bsdf::RoughDielectric(_) => "rough glass",
        Bsdf::Coated(_) => "coated",
        Bsdf::Glossy(_) => "glossy",
        Bsdf::Plastic(_) => "plastic",
        Bsdf::Principled(_) => "principled",
        Bsdf::DiffuseTransmission(_) => "translucent",
        Bsdf::Klems(_) => "BSDF file",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_quoted_for_a_shell() {
        let words = ["/usr/bin/bdpm", "measure", "a room/x.toml", "--sky", "model = 'cie'", ""];
        let expected = r"bdpm measure 'a room/x.toml' --sky 'model = '\''cie'\''' ''";
        assert_eq!(command(&words.map(str::to_owned)), expected);
    }

    #[test]
    fn reflectances_are_those_of_the_materials() {
        use bdpm::scene::bsdf::{Coated, DiffuseTransmission, ThinDielectric};
        let glass = Bsdf::ThinDielectric(ThinDielectric::new(1.5));
        // Both faces of glass reflect .04, with all orders.
        assert!((reflectance(&glass) - 0.0769).abs() < 1e-4);
        let sheet = DiffuseTransmission::new(Vec3::splat(0.3), Vec3::splat(0.5));
        assert!((reflectance(&Bsdf::DiffuseTransmission(sheet)) - 0.3).abs() < 1e-6);
        assert_eq!(reflectance(&Bsdf::diffuse(Vec3::splat(0.6))), 0.6);
        let white = Bsdf::Coated(Coated::new(Vec3::ONE, 1.5));
        assert!((reflectance(&white) - 1.0).abs() < 2e-3, "a white surface absorbs nothing");
    }

    #[test]
    fn checksums_are_those_of_sha256sum() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        let InputFile { bytes, sha256, .. } = input_file(&path).unwrap();
        // FIPS 180-4, appendix B.1
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((bytes, &sha256[..]), (3, known));
    }
}
