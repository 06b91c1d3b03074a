//! Refractive indices of `[materials.NAME]`: a number, the name of a medium, or a table that
//! describes its dispersion.

use crate::text::list;
use bdpm_core::base::error::Error;
use bdpm_core::scene::RefractiveIndex;
use bdpm_core::settings::as_serde;
use serde::de::value::MapAccessDeserializer;
use serde::{Deserialize, Deserializer, de};
use std::fmt;

/// Refractive index of a clear medium.
#[derive(Clone, Debug)]
pub struct Ior(pub RefractiveIndex);

/// The keys of a table.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IndexTable {
    /// Index at 587.56 nm, with `abbe`.
    d: Option<f64>,
    abbe: Option<f64>,
    cauchy: Option<Vec<f64>>,
    sellmeier: Option<Vec<[f64; 2]>>,
    nanometers: Option<Vec<f64>>,
    values: Option<Vec<f64>>,
}

impl IndexTable {
    fn index(self) -> Result<RefractiveIndex, Error> {
        match self {
            Self {
                d: Some(index),
                abbe: Some(abbe),
                cauchy: None,
                sellmeier: None,
                nanometers: None,
                values: None,
            } => Ok(RefractiveIndex::Abbe { index, abbe }),
            Self {
                d: None,
                abbe: None,
                cauchy: Some(terms),
                sellmeier: None,
                nanometers: None,
                values: None,
            } if (1..=3).contains(&terms.len()) => {
                let term = |i: usize| terms.get(i).copied().unwrap_or(0.0);
                Ok(RefractiveIndex::Cauchy([term(0), term(1), term(2)]))
            }
            Self {
                d: None,
                abbe: None,
                cauchy: None,
                sellmeier: Some(terms),
                nanometers: None,
                values: None,
            } => Ok(RefractiveIndex::Sellmeier(terms)),
            Self {
                d: None,
                abbe: None,
                cauchy: None,
                sellmeier: None,
                nanometers: Some(nanometers),
                values: Some(values),
            } => RefractiveIndex::of_samples(nanometers, values),
            _ => Err(Error::new(
                "the table does not describe a refractive index",
                "give `d` and `abbe`, or `cauchy` with up to 3 numbers, or `sellmeier` with pairs, or \
                 as many `nanometers` as `values`",
            )),
        }
    }
}

impl<'de> Deserialize<'de> for Ior {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = RefractiveIndex;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a number, the name of a medium, or a table")
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Result<RefractiveIndex, E> {
                Ok(RefractiveIndex::Constant(value))
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> Result<RefractiveIndex, E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Result<RefractiveIndex, E> {
                self.visit_f64(value as f64)
            }
            fn visit_str<E: de::Error>(self, name: &str) -> Result<RefractiveIndex, E> {
                RefractiveIndex::named(name).ok_or_else(|| {
                    let problem = format!("unknown medium `{name}`");
                    let advice = format!("use one of {}", list(RefractiveIndex::names()));
                    as_serde(Error::new(problem, advice))
                })
            }
            fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<RefractiveIndex, A::Error> {
                let table = IndexTable::deserialize(MapAccessDeserializer::new(map))?;
                table.index().map_err(as_serde)
            }
        }
        from.deserialize_any(Visitor)?.checked().map(Self).map_err(as_serde)
    }
}
