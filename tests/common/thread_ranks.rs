//! Ranks as threads of one process.

use bdpm::mpi::Ranks;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex};

/// Messages between the threads.
pub struct Mail {
    count: u32,
    /// Receiver, sender and message.
    boxes: Mutex<VecDeque<(u32, u32, Vec<u8>)>>,
    news: Condvar,
}

/// A rank.
pub struct Thread<'a> {
    rank: u32,
    mail: &'a Mail,
}

impl Mail {
    /// Mail for this many ranks.
    pub fn new(count: u32) -> Self {
        Self { count, boxes: Mutex::default(), news: Condvar::new() }
    }

    pub fn rank(&self, rank: u32) -> Thread<'_> {
        Thread { rank, mail: self }
    }

    /// Whether all messages were received.
    pub fn is_empty(&self) -> bool {
        self.boxes.lock().unwrap().is_empty()
    }
}

impl Ranks for Thread<'_> {
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
