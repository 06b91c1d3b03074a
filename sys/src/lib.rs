#![doc = include_str!("../README.md")]
#![allow(unsafe_code)] // foreign functions are

#[cfg(not(docs_without_embree))]
mod bindings;
#[cfg(not(docs_without_embree))]
pub use bindings::*;
