//! Prints the intensity of a photometric file in directions from the standard input, for
//! `scripts/radiance_check.py`: three numbers on each line, in the frame of the luminaire, and a
//! number in cd for each of them.
//!
//! ```sh
//! echo 0 0 -1 | cargo run --example luminaire_intensity -- FILE.ies
//! ```

use bdpm::light::photometry::LuminaireFile;
use glam::DVec3;
use std::io::{BufRead, Write};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let name = std::env::args().nth(1).ok_or("give the name of an IES or EULUMDAT file")?;
    let file = LuminaireFile::read(Path::new(&name))?;
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let numbers: Vec<f64> =
            line?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let direction: [f64; 3] = numbers.try_into().map_err(|_| "give three numbers per line")?;
        let direction = DVec3::from_array(direction).normalize();
        writeln!(out, "{}", file.distribution.intensity(direction))?;
    }
    Ok(())
}
