//! Ranks by MPI, whichever the system has.

use super::Ranks;
use crate::base::error::{Error, Result};
use mpi::Threading;
use mpi::environment::Universe;
use mpi::topology::{Process, SimpleCommunicator};
use mpi::traits::{Communicator, Destination, Source};
use std::thread;
use std::time::Duration;

/// The most bytes of a message that MPI takes at once: it counts them in 31 bits.
const MOST: usize = 1 << 30;

/// How long one that waits sleeps: MPI itself would keep a processor busy.
const NAP: Duration = Duration::from_micros(100);

/// All processes that were begun together.
pub struct World {
    world: SimpleCommunicator,
    /// Ends MPI when it is dropped; so after all else.
    _universe: Universe,
}

impl World {
    /// Joins the others.
    ///
    /// # Errors
    /// If MPI does not begin.
    pub fn join() -> Result<Self> {
        let (universe, threading) = mpi::initialize_with_threading(Threading::Funneled)
            .ok_or_else(|| Error::new("MPI has begun already", "report this as a bug"))?;
        if threading < Threading::Funneled {
            return Err(Error::new(
                "this MPI does not work with programs of several threads",
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
        message.chunks(MOST).for_each(|chunk| process.send(chunk));
    }

    fn wait(&self, from: u32) {
        let process = self.process(from);
        while process.immediate_probe().is_none() {
            thread::sleep(NAP);
        }
    }

    fn receive(&self, from: u32) -> Vec<u8> {
        let process = self.process(from);
        let (length, _) = process.receive::<u64>();
        let mut message = vec![0u8; length as usize];
        for chunk in message.chunks_mut(MOST) {
            process.receive_into(chunk);
        }
        message
    }

    fn abort(&self) -> ! {
        self.world.abort(1)
    }
}
