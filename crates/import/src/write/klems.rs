//! Matrices of scattering as BSDF files (XML), as WINDOW writes them.

use super::folder::ExportFolder;
use bdpm_core::base::error::Result;
use bdpm_core::base::names::{Names, for_file};
use bdpm_core::scene::bsdf::{AngleBasis, KlemsMatrices};
use std::fmt::Write as _;
use std::io::{self, Write};

/// The matrices in use, each with the name of its file.
#[derive(Default)]
pub(super) struct BsdfFiles {
    names: Names,
    known: Vec<(&'static KlemsMatrices, String)>,
}

impl BsdfFiles {
    /// The name of the file of matrices, by the material that uses them first.
    pub fn name(&mut self, matrices: &'static KlemsMatrices, material: &str) -> &str {
        let known = self.known.iter().position(|(own, _)| std::ptr::eq(*own, matrices));
        let index = known.unwrap_or_else(|| {
            let name = self.names.unique(for_file(material, "bsdf"));
            self.known.push((matrices, format!("bsdf/{name}.xml")));
            self.known.len() - 1
        });
        &self.known[index].1
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.known.iter().map(|(_, file)| file.as_str())
    }

    pub fn write(&self, out: &ExportFolder) -> Result<()> {
        self.known
            .iter()
            .try_for_each(|(matrices, file)| out.write_part(file, |to| write(matrices, to)))
    }
}

/// Writes a file that [`read`](crate::read::klems::read) reads. Fronts face outside there.
fn write(matrices: &KlemsMatrices, to: &mut dyn Write) -> io::Result<()> {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <WindowElement xmlns=\"http://windows.lbl.gov\">\n\
         <WindowElementType>System</WindowElementType>\n\
         <FileType>BSDF</FileType>\n<Optical>\n<Layer>\n<DataDefinition>\n\
         <IncidentDataStructure>Columns</IncidentDataStructure>\n",
    );
    text += &basis(matrices.basis());
    text += "</DataDefinition>\n<WavelengthData>\n<LayerNumber>System</LayerNumber>\n\
             <Wavelength unit=\"Integral\">Visible</Wavelength>\n";
    for (is_front, side) in [(true, "Back"), (false, "Front")] {
        for (kind, values) in ["Reflection", "Transmission"].iter().zip(matrices.values(is_front)) {
            let _ = write!(
                text,
                "<WavelengthDataBlock>\n\
                 <WavelengthDataDirection>{kind} {side}</WavelengthDataDirection>\n\
                 <ColumnAngleBasis>{NAME}</ColumnAngleBasis>\n\
                 <RowAngleBasis>{NAME}</RowAngleBasis>\n<ScatteringData>\n"
            );
            for row in values.chunks(matrices.basis().patches()) {
                let row: Vec<_> = row.iter().map(f32::to_string).collect();
                text += &row.join(",");
                text += ",\n";
            }
            text += "</ScatteringData>\n</WavelengthDataBlock>\n";
        }
    }
    text += "</WavelengthData>\n</Layer>\n</Optical>\n</WindowElement>\n";
    to.write_all(text.as_bytes())
}

/// Name of the patches, which the file defines.
const NAME: &str = "patches";

fn basis(basis: &AngleBasis) -> String {
    let mut text = format!("<AngleBasis>\n<AngleBasisName>{NAME}</AngleBasisName>\n");
    let mut lower = 0.0;
    for band in basis.bands() {
        let _ = writeln!(
            text,
            "<AngleBasisBlock><nPhis>{}</nPhis><ThetaBounds><LowerTheta>{lower}</LowerTheta>\
             <UpperTheta>{}</UpperTheta></ThetaBounds></AngleBasisBlock>",
            band.patches, band.upper_deg
        );
        lower = band.upper_deg;
    }
    text + "</AngleBasis>\n"
}
