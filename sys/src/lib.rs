#![doc = include_str!("../README.md")]
#![allow(unsafe_code)] // foreign functions are

#[cfg(not(docs_without_embree))]
mod bindings;
#[cfg(all(not(docs_without_embree), not(feature = "link")))]
mod library;
#[cfg(all(not(docs_without_embree), feature = "link"))]
#[path = "linked.rs"]
mod library;

#[cfg(not(docs_without_embree))]
pub use bindings::*;
#[cfg(not(docs_without_embree))]
pub use library::{LoadError, load, load_checked};
