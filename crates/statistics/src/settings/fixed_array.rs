//! Lists of a fixed length in files. Serde's own arrays accept longer lists and drop the rest.

use super::checks::as_serde;
use bdpm_base::error::Error;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::marker::PhantomData;

/// A list of exactly `N` values.
#[derive(Clone, Copy, Debug)]
pub struct FixedArray<T, const N: usize>(pub [T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for FixedArray<T, N> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Entries<T, const N: usize>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Entries<T, N> {
            type Value = [T; N];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a list of {N}")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<[T; N], A::Error> {
                let mut entries = Vec::with_capacity(N);
                while let Some(entry) = list.next_element()? {
                    entries.push(entry);
                }
                entries.try_into().map_err(|entries: Vec<T>| {
                    let problem = format!("the list has {} entries", entries.len());
                    as_serde(Error::new(problem, format!("give {N}")))
                })
            }
        }
        from.deserialize_seq(Entries(PhantomData)).map(Self)
    }
}
