//! `--layers`: layers of an image file.

use bdpm::output::layers::LayerName;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Reads the name of a layer.
pub fn layer_parser() -> impl TypedValueParser<Value = LayerName> {
    let values = LayerName::ALL.map(|name| PossibleValue::new(name.name()).help(name.describe()));
    PossibleValuesParser::new(values)
        .map(|text| LayerName::named(&text).expect("clap admits no other name"))
}
