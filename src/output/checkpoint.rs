//! Checkpoints: an image under way with all that must agree for it to be continued.
//!
//! A file is `magic, format version, payload (postcard), XXH3 of all before`. The checksum is
//! verified before anything is decoded, so a damaged file is always recognized as one.

use crate::adaptive::autopilot;
use crate::adaptive::plan::Plan;
use crate::base::atomic::write_atomically;
use crate::base::error::{Error, Result};
use crate::base::input::read_if_begins;
use crate::base::iteration_set::IterationSet;
use crate::render::PartialRender;
use crate::render::accumulators::SharedStatistics;
use crate::render::block::{Block, PhaseClock};
use crate::scene::Region;
use crate::settings::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::io::{self, Write};
use std::mem;
use std::path::Path;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

const MAGIC: [u8; 8] = *b"bdpm\x1aCP\n";

/// Raised whenever the payload's layout changes.
const FORMAT: u32 = 11;

/// Bytes before the payload.
const HEADER: usize = MAGIC.len() + size_of::<u32>();

/// Bytes after the payload.
const TRAILER: usize = size_of::<u64>();

/// An image under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint<'a> {
    /// What it was made of.
    pub origin: Provenance,
    /// Its sums.
    pub blocks: Cow<'a, [Block]>,
    /// Statistics over all blocks.
    pub shared: Cow<'a, SharedStatistics>,
    /// How far the choice of counts has come, if it is automatic.
    pub autopilot: Option<autopilot::AutopilotState>,
    /// What was to be rendered step by step, if that is known.
    pub plan: Option<Plan>,
    /// What it is a part of, if it is.
    pub whole: Option<Whole>,
    /// The scene's named regions.
    pub regions: Vec<Region>,
}

/// An image that is rendered in parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Whole {
    /// Its iterations.
    pub iterations: u64,
    /// How many parts.
    pub parts: u32,
}

impl Whole {
    /// IterationSet of the iterations of a part, by its index.
    ///
    /// # Panics
    /// Unless there are more parts than that.
    pub fn part(self, index: u32) -> IterationSet {
        IterationSet::from(0..self.iterations).share(index, self.parts)
    }
}

/// A checkpoint as it is written.
#[derive(Serialize, Deserialize)]
struct Payload<'a> {
    origin: Cow<'a, Provenance>,
    blocks: Cow<'a, [Block]>,
    shared: Cow<'a, SharedStatistics>,
    autopilot: Option<autopilot::AutopilotState>,
    plan: Option<Cow<'a, Plan>>,
    whole: Option<Whole>,
    regions: Cow<'a, [Region]>,
    /// Times of the blocks, which only automatic counts depend on: without them, equal images have equal
    /// checkpoints.
    clocks: Vec<PhaseClock>,
}

impl<'a> Checkpoint<'a> {
    /// Of sums at fixed counts, with nothing beside.
    pub fn new(origin: Provenance, blocks: impl Into<Cow<'a, [Block]>>) -> Self {
        Self {
            origin,
            blocks: blocks.into(),
            shared: Cow::Owned(SharedStatistics::default()),
            autopilot: None,
            plan: None,
            whole: None,
            regions: Vec::new(),
        }
    }

    /// Writes it to `path` in place of what was there. Times of iterations are kept only where the counts
    /// are chosen by them.
    ///
    /// # Errors
    /// If the file cannot be written; names it. The old one is then still there.
    pub fn save(&self, path: &Path) -> Result<()> {
        let Self { origin, blocks, shared, autopilot, plan, whole, regions } = self;
        let clocks = match autopilot {
            Some(_) => blocks.iter().map(|block| block.clock).collect(),
            None => Vec::new(),
        };
        let (origin, blocks) = (Cow::Borrowed(origin), Cow::Borrowed(&blocks[..]));
        let shared = Cow::Borrowed(&**shared);
        let plan = plan.as_ref().map(Cow::Borrowed);
        let (autopilot, whole, regions) = (*autopilot, *whole, Cow::Borrowed(&regions[..]));
        let payload = Payload { origin, blocks, shared, autopilot, plan, whole, regions, clocks };
        write_atomically(path, |to| {
            let mut hashing = Hashing { to, hash: Xxh3Default::new(), failure: None };
            hashing.write_all(&MAGIC)?;
            hashing.write_all(&FORMAT.to_le_bytes())?;
            if let Err(e) = postcard::to_io(&payload, &mut hashing) {
                // The encoder does not say why it could not write.
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
    /// If the file cannot be read, is no checkpoint, is from another format version, or is
    /// damaged; names it.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = read_if_begins(path, &MAGIC)?;
        Self::decode(&bytes).map_err(|e| e.at(path))
    }

    fn decode(bytes: &[u8]) -> Result<Self> {
        let damaged = || {
            Error::new(
                "the checkpoint is damaged: its checksum does not match",
                "use another copy of it, or render anew without --resume",
            )
        };
        if !bytes.starts_with(&MAGIC) {
            return Err(Error::new(
                "this is no checkpoint",
                "give a file that --checkpoint has written",
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
        // Only a file whose checksum somebody has forged fails below.
        let (payload, rest): (Payload, _) =
            postcard::take_from_bytes(payload).map_err(|_| damaged())?;
        let Payload { origin, blocks, shared, autopilot, plan, whole, regions, clocks } = payload;
        let (origin, mut blocks) = (origin.into_owned(), blocks.into_owned());
        let (plan, regions) = (plan.map(Cow::into_owned), regions.into_owned());
        origin.settings.validate()?;
        let shared: Cow<SharedStatistics> = Cow::Owned(shared.into_owned());
        let fits = blocks.iter().all(|block| block.is_consistent(&origin.settings))
            && blocks.is_sorted_by(|one, next| one.first < next.first)
            && shared.fits(&origin.settings)
            && plan.as_ref().is_none_or(Plan::is_consistent)
            && whole.is_none_or(|whole| (1..=whole.iterations).contains(&whole.parts.into()));
        let timed = if autopilot.is_some() { blocks.len() } else { 0 };
        if blocks.is_empty() || !fits || clocks.len() != timed || !rest.is_empty() {
            return Err(damaged());
        }
        for (block, clock) in blocks.iter_mut().zip(clocks) {
            block.clock = clock;
        }
        let blocks = Cow::Owned(blocks);
        Ok(Self { origin, blocks, shared, autopilot, plan, whole, regions })
    }
}

/// Hashes what passes through.
struct Hashing<W> {
    to: W,
    hash: Xxh3Default,
    /// Of the last write.
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
    use crate::film::aov::AovSelection;
    use crate::film::counts::{CameraCounts, Counts};
    use crate::film::statistic::{CurrentIteration, PixelStatistic, StatisticTile};
    use crate::noise::film::{BatchGrain, NoiseFilm, PixelMeasurement};
    use crate::render::RenderConfig;
    use crate::settings::{Direct, Kernel, Settings, Strategy};
    use crate::timing::TimeModel;
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
        let settings = Settings {
            width: 5,
            height: 3,
            light_paths: 100,
            camera_paths: 2,
            radius: 0.1,
            caustic_radius: 0.1,
            kernel: Kernel::Area,
            merge_vertex: 2,
            strategy: Strategy::Single,
            direct: Direct::Connect,
            guide: 0,
            bias: crate::settings::Bias::Keep,
            seed: u64::MAX,
            mis_scales: None,
        };
        let aovs = AovSelection { light: true, features: true, folds: true };
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
        let origin = Provenance {
            version: "1.2.3".into(),
            scene: "box".into(),
            fingerprint: 0x1234_5678_9abc_def0,
            backend: "bvh".into(),
            settings,
        };
        let blocks = Cow::Owned(vec![first, second]);
        let plan = Some(Plan::new(counts));
        let whole = Some(Whole { iterations: 100, parts: 9 });
        let regions = vec![Region { name: "ball".into(), rectangles: vec![[0.0, 0.0, 0.5, 1.0]] }];
        Checkpoint {
            origin,
            blocks,
            shared: Cow::Owned(shared),
            autopilot: Some(state()),
            plan,
            whole,
            regions,
        }
    }

    #[test]
    fn times_are_kept_where_counts_are_chosen_by_them() {
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
    fn any_changed_byte_and_any_other_length_is_an_error() {
        let whole = saved();
        assert_eq!(Checkpoint::decode(&whole).unwrap(), checkpoint());
        for position in 0..whole.len() {
            for flip in [1, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[position] ^= flip;
                let shown = Checkpoint::decode(&bytes).unwrap_err().to_string();
                assert!(shown.contains("checkpoint"), "{position}: {shown}");
            }
            assert!(Checkpoint::decode(&whole[..position]).is_err(), "cut at {position}");
        }
        assert!(Checkpoint::decode(&[&whole[..], &[0]].concat()).is_err());
    }

    #[test]
    fn forged_contents_are_errors_and_never_panics() {
        let whole = saved();
        let hashed = whole.len() - TRAILER;
        let mut accepted = 0;
        for position in MAGIC.len()..hashed {
            for byte in [0, 1, 0x7f, 0x80, 0xff] {
                let mut bytes = whole[..hashed].to_vec();
                bytes[position] = byte;
                bytes.extend(xxh3_64(&bytes).to_le_bytes());
                accepted += usize::from(Checkpoint::decode(&bytes).is_ok());
            }
        }
        assert!(accepted > 0, "other pixel values are as good as these");
    }

    #[test]
    fn foreign_files_and_formats_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        fs::write(&path, "hello").unwrap();
        let shown = Checkpoint::load(&path).unwrap_err().to_string();
        assert!(shown.contains("notes.txt: this is no checkpoint\nhelp: "), "{shown}");
        let mut bytes = saved();
        bytes[MAGIC.len()] = 8;
        bytes.truncate(bytes.len() - TRAILER);
        bytes.extend(xxh3_64(&bytes).to_le_bytes());
        let shown = Checkpoint::decode(&bytes).unwrap_err().to_string();
        assert!(shown.contains("has format 8"), "{shown}");
    }
}
