//! The camera of an image, in the metadata of its file.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::image_io::{Metadata, Value};
use bdpm_core::scene::{Camera, FisheyeProjection, Optics};

/// Type of fisheye cameras in scene files.
const FISHEYE: &str = "fisheye";

/// Attribute with the type of the camera, as scene files name it.
const TYPE: &str = "camera";

/// Attribute with the projection of a fisheye camera, as scene files name it.
const PROJECTION: &str = "camera projection";

/// Attribute with the full angle of the image circle of a fisheye camera, degrees.
const FIELD_OF_VIEW: &str = "camera field of view";

/// Camera that the metadata of an image state.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordedCamera {
    /// A fisheye camera.
    Fisheye {
        /// Projection of the lens.
        projection: FisheyeProjection,
        /// Full angle of the image circle, degrees.
        field_of_view: f32,
    },
    /// A camera of another type, as scene files name it.
    Other(String),
}

/// Adds the camera of an image to its metadata.
pub fn record(camera: &Camera, metadata: &mut Metadata) {
    let optics = camera.optics();
    metadata.insert(TYPE.into(), Value::Text(optics.name().into()));
    if let Optics::Fisheye { projection, field_of_view } = optics {
        metadata.insert(PROJECTION.into(), Value::Text(projection.name().into()));
        metadata.insert(FIELD_OF_VIEW.into(), Value::Number(field_of_view.into()));
    }
}

impl RecordedCamera {
    /// The camera that [`record`] added, or `None` if the metadata state no camera.
    ///
    /// # Errors
    /// If the attributes of a fisheye camera are not valid; names the attribute.
    pub fn read(metadata: &Metadata) -> Result<Option<Self>> {
        let name = match metadata.get(TYPE) {
            None => return Ok(None),
            Some(Value::Text(name)) => name,
            Some(Value::Number(_)) => return Err(invalid(TYPE)),
        };
        if name != FISHEYE {
            return Ok(Some(Self::Other(name.clone())));
        }
        let projection = match metadata.get(PROJECTION) {
            Some(Value::Text(text)) => {
                FisheyeProjection::ALL.into_iter().find(|projection| projection.name() == text)
            }
            _ => None,
        };
        let projection = projection.ok_or_else(|| invalid(PROJECTION))?;
        match metadata.get(FIELD_OF_VIEW) {
            Some(&Value::Number(degrees)) if degrees > 0.0 && degrees <= 360.0 => {
                Ok(Some(Self::Fisheye { projection, field_of_view: degrees as f32 }))
            }
            _ => Err(invalid(FIELD_OF_VIEW)),
        }
    }
}

fn invalid(attribute: &str) -> Error {
    let problem = format!("the attribute bdpm.{attribute} is missing or not valid");
    Error::new(problem, "render the image again")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::FieldOfView;
    use glam::Vec3;

    fn recorded(optics: Optics) -> Metadata {
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        let mut metadata = Metadata::new();
        record(&camera, &mut metadata);
        metadata
    }

    #[test]
    fn metadata_keep_type_projection_and_field_of_view() {
        for projection in FisheyeProjection::ALL {
            let optics = Optics::Fisheye { projection, field_of_view: 170.3 };
            let own = RecordedCamera::read(&recorded(optics)).unwrap().unwrap();
            assert_eq!(own, RecordedCamera::Fisheye { projection, field_of_view: 170.3 });
        }
        let pinhole = recorded(Optics::Pinhole(FieldOfView::Y(40.0)));
        let other = RecordedCamera::Other("pinhole".into());
        assert_eq!(RecordedCamera::read(&pinhole).unwrap(), Some(other));
        assert_eq!(RecordedCamera::read(&Metadata::new()).unwrap(), None);
    }

    #[test]
    fn incomplete_metadata_name_the_attribute() {
        let projection = FisheyeProjection::Equisolid;
        let whole = recorded(Optics::Fisheye { projection, field_of_view: 180.0 });
        for attribute in [PROJECTION, FIELD_OF_VIEW] {
            let mut broken = whole.clone();
            broken.insert(attribute.into(), Value::Text("wide".into()));
            let shown = RecordedCamera::read(&broken).unwrap_err().to_string();
            assert!(shown.contains(&format!("bdpm.{attribute}")), "{shown}");
        }
    }
}
