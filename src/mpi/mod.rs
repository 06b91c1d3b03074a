//! Processes that render one image together: ranks, numbered from 0, which decides.
//!
//! All they need is messages from one to another. What goes to all, and what comes from all, goes along a binomial
//! tree: rank `r` hears from `r` without its lowest bit, and tells those that this is true of. A tree of `n` ranks is
//! `log2(n)` messages deep.

#[cfg(feature = "mpi")]
mod system;

use crate::base::error::{Error, Result};
use serde::{Serialize, de::DeserializeOwned};
use std::cell::Cell;
use std::time::{Duration, Instant};

/// How ranks exchange messages.
pub trait Ranks {
    /// Which one this is.
    fn rank(&self) -> u32;

    /// How many there are.
    fn count(&self) -> u32;

    /// Sends a message; those to one rank arrive in their order.
    fn send(&self, to: u32, message: &[u8]);

    /// Waits until the next message of a rank is on its way, and leaves the processor to others.
    fn wait(&self, from: u32);

    /// Receives the next message of a rank.
    fn receive(&self, from: u32) -> Vec<u8>;

    /// Ends all ranks at once, with status 1.
    fn abort(&self) -> !;
}

/// A process by itself.
#[derive(Clone, Copy, Debug)]
pub struct Alone;

impl Ranks for Alone {
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

/// Where launchers tell the number of processes: Open MPI's and MPICH's `mpirun`.
const COUNTS: [&str; 2] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"];

/// Where they, or Slurm's `srun`, tell a process which one it is.
#[cfg(feature = "mpi")]
const NUMBERS: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"];

/// Joins the processes that `mpirun` or a cluster's scheduler began together; a process by itself is one of one. To be
/// called once, by the main thread, which alone may use it.
///
/// # Errors
/// If MPI does not begin; or if several were begun, and this build has no MPI: each would render all by itself.
pub fn join() -> Result<Box<dyn Ranks>> {
    #[cfg(feature = "mpi")]
    if NUMBERS.iter().any(|name| std::env::var_os(name).is_some()) {
        return system::World::join().map(|world| Box::new(world) as Box<dyn Ranks>);
    }
    let count = |name| std::env::var(name).ok()?.trim().parse::<u32>().ok();
    match COUNTS.into_iter().find_map(count) {
        Some(2..) => Err(Error::new(
            "this is one of several processes, but the program was built without MPI",
            "build it with --features mpi (`make mpi`), or begin one process alone",
        )),
        _ => Ok(Box::new(Alone)),
    }
}

/// Times of what ranks exchange, as one of them sees it.
#[derive(Debug, Default)]
pub struct Exchange {
    /// Until others had done their part.
    pub waiting: Cell<Duration>,
    /// Sums on their way, and added up.
    pub adding: Cell<Duration>,
    /// Bytes received.
    pub bytes: Cell<u64>,
}

/// The rank that tells this one, and those that it tells, in the order of their numbers.
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
    /// Whether this is the one that decides.
    pub fn is_first(&self) -> bool {
        self.rank() == 0
    }

    /// What the first rank says, who gives it; the others give `None`.
    ///
    /// # Errors
    /// If it cannot be read: another version speaks.
    pub fn broadcast<T: Serialize + DeserializeOwned>(&self, said: Option<T>) -> Result<T> {
        let (parent, children) = neighbors(self.rank(), self.count());
        let message = match (parent, &said) {
            (Some(parent), _) => {
                self.wait(parent);
                self.receive(parent)
            }
            (None, Some(said)) if self.count() > 1 => encode(said),
            (None, _) => Vec::new(),
        };
        // The one with the most behind it first.
        children.iter().rev().for_each(|&child| self.send(child, &message));
        match said {
            Some(said) if parent.is_none() => Ok(said),
            _ => decode(&message),
        }
    }

    /// Adds up what all ranks have, in an order that depends on their number alone; the first rank gets it.
    ///
    /// # Errors
    /// Those of `add`, and if another version speaks.
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
            let came = Instant::now();
            let message = self.receive(child);
            add(&mut own, decode(&message)?)?;
            times.waiting.set(times.waiting.get() + (came - start));
            times.adding.set(times.adding.get() + came.elapsed());
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

/// A message that [`decode`] reads.
///
/// # Panics
/// If a map has no length before it is written.
pub fn encode(value: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain numbers and texts")
}

/// What [`encode`] wrote.
///
/// # Errors
/// If it is none: another version speaks.
pub fn decode<T: DeserializeOwned>(message: &[u8]) -> Result<T> {
    postcard::from_bytes(message).map_err(|_| {
        Error::new(
            "what another rank says makes no sense",
            "run the same build of bdpm on all machines",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;
    use std::sync::{Condvar, Mutex};

    /// Ranks as threads.
    struct Threads<'a> {
        rank: u32,
        mail: &'a Mail,
    }

    struct Mail {
        count: u32,
        /// To and from whom, and what.
        boxes: Mutex<VecDeque<(u32, u32, Vec<u8>)>>,
        news: Condvar,
    }

    impl Ranks for Threads<'_> {
        fn rank(&self) -> u32 {
            self.rank
        }

        fn count(&self) -> u32 {
            self.mail.count
        }

        fn send(&self, to: u32, message: &[u8]) {
            self.mail.boxes.lock().unwrap().push_back((to, self.rank, message.to_vec()));
            self.mail.news.notify_all();
        }

        fn wait(&self, _: u32) {}

        fn receive(&self, from: u32) -> Vec<u8> {
            let mut boxes = self.mail.boxes.lock().unwrap();
            loop {
                let mine = |(to, by, _): &(u32, u32, Vec<u8>)| (*to, *by) == (self.rank, from);
                if let Some(place) = boxes.iter().position(mine) {
                    return boxes.remove(place).unwrap().2;
                }
                boxes = self.mail.news.wait(boxes).unwrap();
            }
        }

        fn abort(&self) -> ! {
            panic!("aborted")
        }
    }

    #[test]
    fn all_are_told_and_all_are_heard() {
        for count in [1, 2, 3, 5, 8, 13] {
            let mail = Mail { count, boxes: Mutex::default(), news: Condvar::new() };
            let heard: Vec<Option<Vec<u32>>> = std::thread::scope(|scope| {
                let of = |rank| {
                    let mail = &mail;
                    scope.spawn(move || {
                        let threads = Threads { rank, mail };
                        let ranks: &dyn Ranks = &threads;
                        let said = ranks.is_first().then(|| "go".to_owned());
                        assert_eq!(ranks.broadcast(said).unwrap(), "go");
                        let add = |all: &mut Vec<u32>, others: Vec<u32>| {
                            all.extend(others);
                            Ok(())
                        };
                        ranks.reduce(vec![rank], &Exchange::default(), add).unwrap()
                    })
                };
                let all: Vec<_> = (0..count).map(of).collect();
                all.into_iter().map(|one| one.join().unwrap()).collect()
            });
            assert_eq!(heard[0], Some((0..count).collect()));
            assert!(heard[1..].iter().all(Option::is_none));
            assert!(mail.boxes.lock().unwrap().is_empty());
        }
    }
}
