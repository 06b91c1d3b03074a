//! Regions of the image for statistics: by name, or as a rectangle.

use super::image::NoiseImage;
use crate::settings::{Region, check_rectangles};
use bdpm_base::error::{Error, Result};

/// Writes rectangles as text: `x0,y0,x1,y1` each, separated by spaces.
pub fn rectangles_to_text(rectangles: &[[f64; 4]]) -> String {
    let one = |r: &[f64; 4]| r.map(|x| x.to_string()).join(",");
    rectangles.iter().map(one).collect::<Vec<_>>().join(" ")
}

/// Reads the text that [`rectangles_to_text`] wrote.
///
/// # Errors
/// If the text is not a list of rectangles, or a rectangle is not in the image.
pub fn rectangles_from_text(text: &str) -> Result<Vec<[f64; 4]>> {
    let one = |text: &str| {
        let numbers: Vec<f64> =
            text.split(',').map(|x| x.trim().parse().ok()).collect::<Option<_>>()?;
        numbers.try_into().ok()
    };
    let rectangles: Option<Vec<[f64; 4]>> = text.split_whitespace().map(one).collect();
    let rectangles = rectangles.ok_or_else(|| {
        Error::new(
            format!("`{text}` is not a rectangle"),
            "give four numbers x0,y0,x1,y1 in fractions of the image, the origin at the top left",
        )
    })?;
    check_rectangles(&rectangles)?;
    Ok(rectangles)
}

/// The region that `choice` names: one of `known` by name, a rectangle `x0,y0,x1,y1` in fractions
/// of the image, or the whole image without a choice.
///
/// # Errors
/// If the name is not known (lists those that are) or the rectangle is not in the image.
pub fn find(choice: Option<&str>, known: &[Region]) -> Result<Region> {
    let Some(choice) = choice else {
        let rectangles = vec![[0.0, 0.0, 1.0, 1.0]];
        return Ok(Region { name: "whole image".into(), rectangles });
    };
    if let Some(region) = known.iter().find(|region| region.name == choice) {
        return Ok(region.clone());
    }
    if choice.contains(',') {
        let compact: String = choice.split_whitespace().collect();
        return Ok(Region { name: compact.clone(), rectangles: rectangles_from_text(&compact)? });
    }
    let names: Vec<_> = known.iter().map(|region| &region.name[..]).collect();
    Err(Error::new(
        format!("there is no region `{choice}`"),
        match &names[..] {
            [] => "the scene names no region; give a rectangle X0,Y0,X1,Y1 in fractions of the \
                   image"
                .into(),
            names => format!("use {}, or a rectangle X0,Y0,X1,Y1", names.join(", ")),
        },
    ))
}

/// Indices of the pixels of `image` whose centers lie in `region`.
///
/// # Errors
/// If no pixel center lies in the region.
pub fn pixels(region: &Region, image: &NoiseImage) -> Result<Vec<usize>> {
    let pixels = image.select(|x, y, width, height| region.contains(x, y, width, height));
    if pixels.is_empty() {
        return Err(Error::new(
            format!(
                "no pixel center of the {}x{} image lies in the region {}",
                image.width, image.height, region.name
            ),
            "give a larger region, or measure at a higher resolution",
        ));
    }
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known() -> Vec<Region> {
        let region = |name: &str, rectangles| Region { name: name.into(), rectangles };
        vec![
            region("walls", vec![[0.0, 0.1, 0.25, 1.0], [1.0 / 3.0, 0.0, 1.0, 0.5]]),
            region("floor", vec![[0.0, 0.5, 1.0, 1.0]]),
        ]
    }

    #[test]
    fn rectangles_survive_text_exactly() {
        for region in known() {
            let text = rectangles_to_text(&region.rectangles);
            assert_eq!(rectangles_from_text(&text).unwrap(), region.rectangles);
        }
    }

    #[test]
    fn regions_are_found_by_name_or_rectangle() {
        assert_eq!(find(Some("walls"), &known()).unwrap(), known()[0]);
        let rectangle = find(Some("0, 0,0.5,1"), &known()).unwrap();
        assert_eq!(rectangle.rectangles, [[0.0, 0.0, 0.5, 1.0]]);
        assert!(find(None, &[]).unwrap().contains(6, 6, 7, 7));
    }

    #[test]
    fn wrong_regions_are_refused() {
        for (wish, expected) in [
            ("ceiling", "walls, floor"),
            ("0,0,1", "four numbers"),
            ("0,0,1,x", "four numbers"),
            ("0,0,1,1 0,0,1,1", "four numbers"),
            ("0,0,1,2", "not in the image"),
            ("0.5,0,0.5,1", "not in the image"),
            ("0,0,NaN,1", "not in the image"),
        ] {
            let shown = find(Some(wish), &known()).unwrap_err().to_string();
            assert!(shown.contains(expected) && shown.contains("\nhelp: "), "{wish}: {shown}");
        }
        assert!(find(Some("x"), &[]).unwrap_err().to_string().contains("names no region"));
    }
}
