//! Exchange of messages between the processes of one image.

use crate::common::thread_ranks::Mail;
use bdpm::mpi::{Exchange, Ranks};

#[test]
fn broadcast_reaches_all_ranks_and_reduction_collects_all() {
    for count in [1, 2, 3, 5, 8, 13] {
        let mail = Mail::new(count);
        let sums: Vec<Option<Vec<u32>>> = std::thread::scope(|scope| {
            let of = |rank| {
                let mail = &mail;
                scope.spawn(move || {
                    let thread = mail.rank(rank);
                    let ranks: &dyn Ranks = &thread;
                    let value = ranks.is_first().then(|| "go".to_owned());
                    assert_eq!(ranks.broadcast(value).unwrap(), "go");
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
        assert_eq!(sums[0], Some((0..count).collect()));
        assert!(sums[1..].iter().all(Option::is_none));
        assert!(mail.is_empty());
    }
}
