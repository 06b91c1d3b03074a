//! Checkpoints: an unfinished image with the data that is needed to continue it.
//!
//! A file consists of magic bytes, format version, payload (postcard) and the XXH3 checksum of
//! these. The checksum is verified before anything is decoded, so a damaged file is always
//! recognized.

use bdpm_auto::adaptive::autopilot;
use bdpm_auto::adaptive::plan::Plan;
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::read_if_begins;
use bdpm_core::base::iteration_set::IterationSet;
use bdpm_core::render::PartialRender;
use bdpm_core::render::accumulators::SharedStatistics;
use bdpm_core::render::audit::AuditSums;
use bdpm_core::render::block::{Block, PhaseClock};
use bdpm_core::scene::Region;
use bdpm_core::settings::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::io::{self, Write};
use std::mem;
use std::path::Path;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

const MAGIC: [u8; 8] = *b"bdpm\x1aCP\n";

/// Version of the payload's layout. Increase it with every change.
const FORMAT: u32 = 18;

/// Bytes before the payload.
const HEADER: usize = MAGIC.len() + size_of::<u32>();

/// Bytes after the payload.
const TRAILER: usize = size_of::<u64>();

/// An unfinished image.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint<'a> {
    /// Version, scene, backend and settings.
    pub provenance: Provenance,
    /// Sums of the blocks.
    pub blocks: Cow<'a, [Block]>,
    /// Statistics over all blocks.
    pub shared: Cow<'a, SharedStatistics>,
    /// State of the choice of path counts, if it is automatic.
    pub autopilot: Option<autopilot::AutopilotState>,
    /// The plan, if the image has one.
    pub plan: Option<Plan>,
    /// Size of the whole image, if this is a shard.
    pub sharded: Option<ShardedImage>,
    /// The scene's named regions.
    pub regions: Vec<Region>,
    /// Sums of the audit, if the image is audited.
    pub audit: Option<AuditSums>,
}

/// An image whose iterations are split into shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardedImage {
    /// Number of iterations of the image.
    pub iterations: u64,
    /// Number of shards.
    pub shards: u32,
}

impl ShardedImage {
    /// The iterations of a shard, by its index.
    ///
    /// # Panics
    /// If the index is not less than the number of shards.
    pub fn shard(self, index: u32) -> IterationSet {
        IterationSet::from(0..self.iterations).share(index, self.shards)
    }
}

/// The payload of a file.
#[derive(Serialize, Deserialize)]
struct Payload<'a> {
    provenance: Cow<'a, Provenance>,
    blocks: Cow<'a, [Block]>,
    shared: Cow<'a, SharedStatistics>,
    autopilot: Option<autopilot::AutopilotState>,
    plan: Option<Cow<'a, Plan>>,
    sharded: Option<ShardedImage>,
    regions: Cow<'a, [Region]>,
    audit: Option<Cow<'a, AuditSums>>,
    /// Times of the blocks; empty unless path counts are automatic, so that equal images have equal
    /// checkpoints.
    clocks: Vec<PhaseClock>,
}

impl<'a> Checkpoint<'a> {
    /// A checkpoint of sums at fixed path counts, without further statistics.
    pub fn new(provenance: Provenance, blocks: impl Into<Cow<'a, [Block]>>) -> Self {
        Self {
            provenance,
            blocks: blocks.into(),
            shared: Cow::Owned(SharedStatistics::default()),
            autopilot: None,
            plan: None,
            sharded: None,
            regions: Vec::new(),
            audit: None,
        }
    }

    /// Writes the checkpoint to `path`, and replaces the file there. Times of iterations are
    /// written only if path counts are chosen by them.
    ///
    /// # Errors
    /// If the file cannot be written; the old file is then unchanged. The error names the file.
    pub fn save(&self, path: &Path) -> Result<()> {
        let Self { provenance, blocks, shared, autopilot, plan, sharded, regions, audit } = self;
        let clocks = match autopilot {
            Some(_) => blocks.iter().map(|block| block.clock).collect(),
            None => Vec::new(),
        };
        let (provenance, blocks) = (Cow::Borrowed(provenance), Cow::Borrowed(&blocks[..]));
        let shared = Cow::Borrowed(&**shared);
        let plan = plan.as_ref().map(Cow::Borrowed);
        let (autopilot, sharded, regions) = (*autopilot, *sharded, Cow::Borrowed(&regions[..]));
        let audit = audit.as_ref().map(Cow::Borrowed);
        let payload = Payload {
            provenance,
            blocks,
            shared,
            autopilot,
            plan,
            sharded,
            regions,
            audit,
            clocks,
        };
        write_atomically(path, |to| {
            let mut hashing = Hashing { to, hash: Xxh3Default::new(), failure: None };
            hashing.write_all(&MAGIC)?;
            hashing.write_all(&FORMAT.to_le_bytes())?;
            if let Err(e) = postcard::to_io(&payload, &mut hashing) {
                // The encoder hides the cause of a failed write.
                return Err(hashing.failure.unwrap_or_else(|| io::Error::other(e)));
            }
            let digest = hashing.hash.digest();
            hashing.to.write_all(&digest.to_le_bytes())
        })
    }
}

impl Checkpoint<'static> {
    /// Takes the sums and leaves none.
    pub fn take_partial(&mut self) -> PartialRender {
        PartialRender::new(mem::take(self.blocks.to_mut()), mem::take(self.shared.to_mut()))
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read, is not a checkpoint, has another format version, or is damaged.
    /// The error names the file.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = read_if_begins(path, &MAGIC)?;
        Self::decode(&bytes).map_err(|e| e.at(path))
    }

    fn decode(bytes: &[u8]) -> Result<Self> {
        let payload = payload_of(bytes)?;
        // Below, only a file with a forged checksum fails.
        let (payload, rest): (Payload, _) =
            postcard::take_from_bytes(payload).map_err(|_| damaged())?;
        let Payload {
            provenance,
            blocks,
            shared,
            autopilot,
            plan,
            sharded,
            regions,
            audit,
            clocks,
        } = payload;
        let audit = audit.map(Cow::into_owned);
        let (provenance, mut blocks) = (provenance.into_owned(), blocks.into_owned());
        let (plan, regions) = (plan.map(Cow::into_owned), regions.into_owned());
        provenance.settings.validate()?;
        let shared: Cow<SharedStatistics> = Cow::Owned(shared.into_owned());
        let fits = blocks.iter().all(|block| block.is_consistent(&provenance.settings))
            && blocks.is_sorted_by(|one, next| one.first < next.first)
            && shared.fits(&provenance.settings)
            && plan.as_ref().is_none_or(Plan::is_consistent)
            && audit.as_ref().is_none_or(|audit| audit.fits(&provenance.settings))
            && sharded
                .is_none_or(|sharded| (1..=sharded.iterations).contains(&sharded.shards.into()));
        let timed = if autopilot.is_some() { blocks.len() } else { 0 };
        if blocks.is_empty() || !fits || clocks.len() != timed || !rest.is_empty() {
            return Err(damaged());
        }
        for (block, clock) in blocks.iter_mut().zip(clocks) {
            block.clock = clock;
        }
        let blocks = Cow::Owned(blocks);
        Ok(Self { provenance, blocks, shared, autopilot, plan, sharded, regions, audit })
    }
}

/// The error for a file that is not as it was written.
fn damaged() -> Error {
    Error::new(
        "the checkpoint is damaged: its checksum does not match",
        "use another copy of it, or start a new image",
    )
}

/// The encoded state in the bytes of a file, after the checks of its header and its checksum.
fn payload_of(bytes: &[u8]) -> Result<&[u8]> {
    if !bytes.starts_with(&MAGIC) {
        return Err(Error::new(
            "this is not a checkpoint",
            "give a checkpoint that `bdpm render` wrote",
        ));
    }
    if bytes.len() < HEADER + TRAILER {
        return Err(damaged());
    }
    let (hashed, digest) = bytes.split_at(bytes.len() - TRAILER);
    if xxh3_64(hashed).to_le_bytes() != digest {
        return Err(damaged());
    }
    let (header, payload) = hashed.split_at(HEADER);
    let format = &header[MAGIC.len()..];
    if format != FORMAT.to_le_bytes() {
        let format = format.iter().rev().fold(0u32, |n, &byte| n << 8 | u32::from(byte));
        return Err(Error::new(
            format!("the checkpoint has format {format}; this version reads format {FORMAT}"),
            "continue it with the version of bdpm that wrote it",
        ));
    }
    Ok(payload)
}

/// Hashes the bytes that are written.
struct Hashing<W> {
    to: W,
    hash: Xxh3Default,
    /// Error of the last write.
    failure: Option<io::Error>,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.to.write(bytes) {
            Ok(written) => {
                self.hash.update(&bytes[..written]);
                Ok(written)
            }
            Err(e) => {
                let same = e.raw_os_error().map_or(e.kind().into(), io::Error::from_raw_os_error);
                self.failure = Some(e);
                Err(same)
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_auto::timing::TimeModel;
    use bdpm_core::film::aov::AovSelection;
    use bdpm_core::film::counts::{CameraCounts, Counts};
    use bdpm_core::film::statistic::{CurrentIteration, PixelStatistic, StatisticTile};
    use bdpm_core::noise::film::{BatchGrain, NoiseFilm, PixelMeasurement};
    use bdpm_core::render::RenderConfig;
    use bdpm_core::settings::{PartialSettings, Settings};
    use glam::DVec3;
    use std::fs;

    fn state() -> autopilot::AutopilotState {
        let times = TimeModel {
            fixed: 1e-3,
            light_path: 1e-6,
            camera_path: 2e-6,
            look_up: 1e-7,
            merge_pair: 1e-9,
            pixels: 35.0,
        };
        autopilot::AutopilotState::new(times, 1e-4)
    }

    fn checkpoint() -> Checkpoint<'static> {
        let none = PartialSettings::default();
        let typical = Settings::resolve(&none, &none, 1.0).unwrap();
        let settings =
            Settings { width: 5, height: 3, light_paths: 100, seed: u64::MAX, ..typical };
        let aovs = AovSelection { light: true, features: true, folds: true, halves: false };
        let config = RenderConfig { aovs, ..RenderConfig::default() };
        let request = config.request(&settings);
        let first =
            Block::new(&RenderConfig::default().request(&settings), 0, Counts::uniform(100, 2));
        let camera_paths = CameraCounts::PerPixel((1..=15).collect());
        let counts = Counts { light_paths: 70, camera_paths };
        let mut second = Block::new(&request, 3, counts.clone());
        for (_, sums) in second.film.sums.tiles_mut() {
            for (index, sums) in sums.iter_mut().enumerate() {
                sums.add(DVec3::new(1e-300, index as f64, 0.1));
            }
        }
        second.film.iterations = 7;
        second.numbers = IterationSet::from(4..11);
        second.film.deviations.add(0.3, 1);
        let mut noise = NoiseFilm::new(settings.resolution(), BatchGrain::Tile, 0);
        let measured = PixelMeasurement { value: 0.1, ..Default::default() };
        let iteration = CurrentIteration { number: 4, is_measured: true };
        noise.tiles_mut(iteration)[0].add_sample(3, &measured);
        noise.end_iteration(iteration);
        second.statistics.noise = Some(noise);
        let mut shared = SharedStatistics::default();
        shared.start(&request);
        let provenance = Provenance {
            version: "1.2.3".into(),
            scene: "box".into(),
            fingerprint: 0x1234_5678_9abc_def0,
            backend: "bvh".into(),
            settings,
        };
        let blocks = Cow::Owned(vec![first, second]);
        let plan = Some(Plan::new(counts));
        let sharded = Some(ShardedImage { iterations: 100, shards: 9 });
        let regions = vec![Region { name: "ball".into(), rectangles: vec![[0.0, 0.0, 0.5, 1.0]] }];
        Checkpoint {
            provenance,
            blocks,
            shared: Cow::Owned(shared),
            autopilot: Some(state()),
            plan,
            sharded,
            regions,
            audit: None,
        }
    }

    #[test]
    fn times_are_written_only_for_automatic_counts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ckpt");
        let with = |iterations: u64, autopilot| {
            let mut own = Checkpoint { autopilot, ..checkpoint() };
            own.blocks.to_mut()[1].clock.iterations = iterations;
            own.save(&path).unwrap();
            (Checkpoint::load(&path).unwrap().blocks[1].clock, fs::read(&path).unwrap())
        };
        let (clock, automatic) = with(3, Some(state()));
        assert_eq!(clock.iterations, 3);
        assert_ne!(automatic, with(4, Some(state())).1);
        let (clock, fixed) = with(3, None);
        assert_eq!(clock, PhaseClock::default());
        assert_eq!(fixed, with(4, None).1);
    }

    fn saved() -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ckpt");
        checkpoint().save(&path).unwrap();
        assert_eq!(Checkpoint::load(&path).unwrap(), checkpoint());
        fs::read(&path).unwrap()
    }

    #[test]
    fn changed_byte_or_length_is_an_error() {
        let sharded = saved();
        assert_eq!(Checkpoint::decode(&sharded).unwrap(), checkpoint());
        for position in 0..sharded.len() {
            for flip in [1, 0x80, 0xff] {
                let mut bytes = sharded.clone();
                bytes[position] ^= flip;
                let shown = Checkpoint::decode(&bytes).unwrap_err().to_string();
                assert!(shown.contains("checkpoint"), "{position}: {shown}");
            }
            assert!(Checkpoint::decode(&sharded[..position]).is_err(), "cut at {position}");
        }
        assert!(Checkpoint::decode(&[&sharded[..], &[0]].concat()).is_err());
    }

    #[test]
    fn forged_content_never_panics() {
        let sharded = saved();
        let hashed = sharded.len() - TRAILER;
        let mut accepted = 0;
        for position in MAGIC.len()..hashed {
            for byte in [0, 1, 0x7f, 0x80, 0xff] {
                let mut bytes = sharded[..hashed].to_vec();
                bytes[position] = byte;
                bytes.extend(xxh3_64(&bytes).to_le_bytes());
                accepted += usize::from(Checkpoint::decode(&bytes).is_ok());
            }
        }
        assert!(accepted > 0, "other pixel values are as good as these");
    }

    #[test]
    fn foreign_file_and_format_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        fs::write(&path, "hello").unwrap();
        let shown = Checkpoint::load(&path).unwrap_err().to_string();
        assert!(shown.contains("notes.txt: this is not a checkpoint\nhelp: "), "{shown}");
        let mut bytes = saved();
        bytes[MAGIC.len()] = 8;
        bytes.truncate(bytes.len() - TRAILER);
        bytes.extend(xxh3_64(&bytes).to_le_bytes());
        let shown = Checkpoint::decode(&bytes).unwrap_err().to_string();
        assert!(shown.contains("has format 8"), "{shown}");
    }
}
