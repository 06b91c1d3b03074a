//! Ranks by the MPI library of the system.

use super::Ranks;
use bdpm_core::base::error::{Error, Result};
use mpi::Threading;
use mpi::environment::Universe;
use mpi::topology::{Process, SimpleCommunicator};
use mpi::traits::{Communicator, Destination, Source};
use std::thread;
use std::time::Duration;

/// Maximum of bytes that MPI sends at once: it counts them in 31 bits.
const MAX_CHUNK: usize = 1 << 30;

/// Sleep between checks for a message: MPI itself would keep a processor busy while it waits.
const POLL_INTERVAL: Duration = Duration::from_micros(100);

/// All processes that were started together.
pub struct World {
    world: SimpleCommunicator,
    /// Ends MPI when it is dropped, so it must be the last field.
    _universe: Universe,
}

impl World {
    /// Joins the others.
    ///
    /// # Errors
    /// If MPI does not start.
    pub fn join() -> Result<Self> {
        let (universe, threading) = mpi::initialize_with_threading(Threading::Funneled)
            .ok_or_else(|| Error::new("MPI was started already", "report this as a bug"))?;
        if threading < Threading::Funneled {
            return Err(Error::new(
                "this MPI does not support programs with several threads",
                "use one that was built with thread support, such as Debian's",
            ));
        }
        Ok(Self { world: universe.world(), _universe: universe })
    }

    fn process(&self, rank: u32) -> Process<'_> {
        self.world.process_at_rank(rank as i32)
    }
}

impl Ranks for World {
    fn rank(&self) -> u32 {
        self.world.rank() as u32
    }

    fn count(&self) -> u32 {
        self.world.size() as u32
    }

    fn send(&self, to: u32, message: &[u8]) {
        let process = self.process(to);
        process.send(&[message.len() as u64][..]);
        message.chunks(MAX_CHUNK).for_each(|chunk| process.send(chunk));
    }

    fn wait(&self, from: u32) {
        let process = self.process(from);
        while process.immediate_probe().is_none() {
            thread::sleep(POLL_INTERVAL);
        }
    }

    fn receive(&self, from: u32) -> Vec<u8> {
        let process = self.process(from);
        let (length, _) = process.receive::<u64>();
        let mut message = vec![0u8; length as usize];
        for chunk in message.chunks_mut(MAX_CHUNK) {
            process.receive_into(chunk);
        }
        message
    }

    fn abort(&self) -> ! {
        self.world.abort(1)
    }
}
