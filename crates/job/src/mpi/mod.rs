//! Processes that render one image together: ranks, numbered from 0. Rank 0 decides.
//!
//! Ranks send messages to each other. Broadcasts and reductions use a binomial tree: the parent of
//! rank `r` is `r` without its lowest set bit. A tree of `n` ranks is `log2(n)` messages deep.

#[cfg(feature = "mpi")]
mod system;

use bdpm_core::base::error::{Error, Result};
use serde::{Serialize, de::DeserializeOwned};
use std::cell::Cell;
use std::time::{Duration, Instant};

/// Exchange of messages between ranks.
pub trait Ranks {
    /// Number of this rank.
    fn rank(&self) -> u32;

    /// Number of ranks.
    fn count(&self) -> u32;

    /// Sends a message. Messages to one rank arrive in the order of sending.
    fn send(&self, to: u32, message: &[u8]);

    /// Waits until the next message of a rank arrives, without using the processor.
    fn wait(&self, from: u32);

    /// Receives the next message of rank `from`.
    fn receive(&self, from: u32) -> Vec<u8>;

    /// Ends all ranks immediately, with status 1.
    fn abort(&self) -> !;
}

/// A single process without others.
#[derive(Clone, Copy, Debug)]
pub struct SingleProcess;

impl Ranks for SingleProcess {
    fn rank(&self) -> u32 {
        0
    }

    fn count(&self) -> u32 {
        1
    }

    fn send(&self, _: u32, _: &[u8]) {}

    fn wait(&self, _: u32) {}

    fn receive(&self, _: u32) -> Vec<u8> {
        Vec::new()
    }

    fn abort(&self) -> ! {
        std::process::exit(1)
    }
}

/// Environment variables with the number of processes: of the `mpirun` of Open MPI and MPICH.
const COUNT_VARIABLES: [&str; 2] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"];

/// Environment variables with the number of the rank: of `mpirun`, or of Slurm's `srun`.
#[cfg(feature = "mpi")]
const RANK_VARIABLES: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"];

/// Joins the processes that `mpirun` or a cluster's scheduler started together. Call it once, on
/// the main thread, and use the result on that thread only.
///
/// # Errors
/// If MPI does not start. If several processes were started and this build has no MPI: each would
/// render everything.
pub fn join() -> Result<Box<dyn Ranks>> {
    #[cfg(feature = "mpi")]
    if RANK_VARIABLES.iter().any(|name| std::env::var_os(name).is_some()) {
        return system::World::join().map(|world| Box::new(world) as Box<dyn Ranks>);
    }
    let count = |name| std::env::var(name).ok()?.trim().parse::<u32>().ok();
    match COUNT_VARIABLES.into_iter().find_map(count) {
        Some(2..) => Err(Error::new(
            "this is one of several processes, but the program was built without MPI",
            "build it with the feature mpi (`make mpi`), or start a single process",
        )),
        _ => Ok(Box::new(SingleProcess)),
    }
}

/// Times of the exchange between ranks, as this one measures them.
#[derive(Debug, Default)]
pub struct Exchange {
    /// Waiting for messages of others.
    pub waiting: Cell<Duration>,
    /// Receiving and adding sums.
    pub adding: Cell<Duration>,
    /// Bytes received.
    pub bytes: Cell<u64>,
}

/// Parent and children of a rank in the tree, children in the order of their numbers.
fn neighbors(rank: u32, count: u32) -> (Option<u32>, Vec<u32>) {
    let mut children = Vec::new();
    for bit in (0..32).map(|bit| 1u32 << bit) {
        if rank & bit != 0 {
            return (Some(rank - bit), children);
        }
        match rank.checked_add(bit) {
            Some(child) if child < count => children.push(child),
            _ if bit >= count => break,
            _ => {}
        }
    }
    (None, children)
}

impl dyn Ranks + '_ {
    /// Whether this rank decides.
    pub fn is_first(&self) -> bool {
        self.rank() == 0
    }

    /// Sends a value from the first rank to all. The first rank passes the value, the others
    /// `None`.
    ///
    /// # Errors
    /// If the message cannot be read because ranks run different versions.
    pub fn broadcast<T: Serialize + DeserializeOwned>(&self, value: Option<T>) -> Result<T> {
        let (parent, children) = neighbors(self.rank(), self.count());
        let message = match (parent, &value) {
            (Some(parent), _) => {
                self.wait(parent);
                self.receive(parent)
            }
            (None, Some(value)) if self.count() > 1 => encode(value),
            (None, _) => Vec::new(),
        };
        // Start with the child that has the largest subtree.
        children.iter().rev().for_each(|&child| self.send(child, &message));
        match value {
            Some(value) if parent.is_none() => Ok(value),
            _ => decode(&message),
        }
    }

    /// Adds up the values of all ranks and returns the sum on the first rank. The order depends on
    /// the number of ranks only.
    ///
    /// # Errors
    /// Errors of `add`; and if a message cannot be read because ranks run different versions.
    pub fn reduce<T: Serialize + DeserializeOwned>(
        &self,
        mut own: T,
        times: &Exchange,
        mut add: impl FnMut(&mut T, T) -> Result<()>,
    ) -> Result<Option<T>> {
        let (parent, children) = neighbors(self.rank(), self.count());
        for child in children {
            let start = Instant::now();
            self.wait(child);
            let arrival = Instant::now();
            let message = self.receive(child);
            add(&mut own, decode(&message)?)?;
            times.waiting.set(times.waiting.get() + (arrival - start));
            times.adding.set(times.adding.get() + arrival.elapsed());
            times.bytes.set(times.bytes.get() + message.len() as u64);
        }
        match parent {
            Some(parent) => {
                self.send(parent, &encode(&own));
                Ok(None)
            }
            None => Ok(Some(own)),
        }
    }
}

/// Converts a value to a message for [`decode`].
///
/// # Panics
/// If a map has no length before it is written.
pub fn encode(value: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain numbers and texts")
}

/// Reads a message of [`encode`].
///
/// # Errors
/// If the message is not of this type, because ranks run different versions.
pub fn decode<T: DeserializeOwned>(message: &[u8]) -> Result<T> {
    postcard::from_bytes(message).map_err(|_| {
        Error::new(
            "cannot read the message of another rank",
            "run the same build of bdpm on all machines",
        )
    })
}
