//! Plans: path counts, number of iterations and weight of each step of a render. A render that
//! chose its counts writes its plan to the image file. A render with this plan is bit-identical.
//!
//! In an EXR file, the attribute `bdpm.plan` is a JSON list of steps with the keys `light_paths`
//! and `camera_paths`. Steps that were rendered also have `iterations` and `weight`. If camera
//! paths differ between pixels, `camera_paths` is the name of a layer whose channel `Y` holds them.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::counts::{CameraCounts, Counts};
use bdpm_core::image_io::{Image, Layer, Value};
use bdpm_core::render::block::Block;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Name of the attribute.
const ATTRIBUTE: &str = "plan";

/// The steps of a render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// At least one.
    pub steps: Vec<Step>,
}

/// Iterations at equal counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// The counts.
    pub counts: Counts,
    /// Number and weight of the iterations; `None` if the number is open.
    pub rendered: Option<Rendered>,
}

/// Number and weight of the iterations of a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rendered {
    /// Number of iterations.
    pub iterations: u64,
    /// Weight of each iteration in the image.
    pub weight: f64,
}

/// A step in the file.
#[derive(Serialize, Deserialize)]
struct WrittenStep {
    light_paths: u32,
    camera_paths: WrittenCounts,
    #[serde(flatten)]
    rendered: Option<Rendered>,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum WrittenCounts {
    Uniform(u32),
    Layer(String),
}

impl Plan {
    /// One step with an open number of iterations.
    pub fn new(counts: Counts) -> Self {
        Self { steps: vec![Step { counts, rendered: None }] }
    }

    /// The plan of an image of `blocks`, with the weight of an iteration of each block.
    pub fn of_blocks(blocks: &[Block], weights: &[f64]) -> Self {
        let step = |(block, &weight): (&Block, &f64)| Step {
            counts: block.counts.clone(),
            rendered: Some(Rendered { iterations: block.film.iterations, weight }),
        };
        let rendered = blocks.iter().zip(weights).filter(|(block, _)| block.film.iterations > 0);
        Self { steps: rendered.map(step).collect() }
    }

    /// Total number of iterations, unless it is open.
    pub fn iterations(&self) -> Option<u64> {
        self.steps.iter().map(|step| Some(step.rendered?.iterations)).sum()
    }

    /// Iterations of each step. The last range has no end.
    pub fn ranges(&self) -> Vec<Range<u64>> {
        let mut start = 0;
        let mut range = |(index, step): (usize, &Step)| {
            let length = step.rendered.map_or(u64::MAX, |rendered| rendered.iterations);
            let end = if index + 1 < self.steps.len() { start + length } else { u64::MAX };
            std::mem::replace(&mut start, end)..end
        };
        self.steps.iter().enumerate().map(&mut range).collect()
    }

    /// Weights of the iterations of each block; 1 if the number of iterations is open.
    pub fn weights(&self, blocks: &[Block]) -> Vec<f64> {
        let starts = self.ranges();
        let weight = |block: &Block| {
            let step = starts.iter().position(|range| range.start == block.first);
            let rendered = step.and_then(|step| self.steps[step].rendered);
            rendered.map_or(1.0, |rendered| rendered.weight)
        };
        blocks.iter().map(weight).collect()
    }

    /// Returns true if a plan from a file is valid: positive weights and iterations, or a single
    /// open step.
    pub fn is_consistent(&self) -> bool {
        let positive = |weight: f64| weight > 0.0 && weight.is_finite();
        let valid = |step: &Step| match step.rendered {
            Some(Rendered { iterations, weight }) => iterations > 0 && positive(weight),
            None => self.steps.len() == 1,
        };
        let sum =
            |sum: u64, step: &Step| sum.checked_add(step.rendered.map_or(0, |r| r.iterations));
        !self.steps.is_empty()
            && self.steps.iter().all(valid)
            && self.steps.iter().try_fold(0, sum).is_some()
    }

    /// Adds the plan to the attributes and layers of an image.
    pub fn write_to(&self, image: &mut Image) {
        let mut written = Vec::new();
        for (index, step) in self.steps.iter().enumerate() {
            let camera_paths = match &step.counts.camera_paths {
                CameraCounts::Uniform(count) => WrittenCounts::Uniform(*count),
                CameraCounts::PerPixel(counts) => {
                    let name = format!("{ATTRIBUTE}{index}");
                    // Exact up to 2^24, far above useful counts.
                    let values = counts.iter().map(|&count| count as f32).collect();
                    let channels = vec![("Y".into(), values)];
                    image.layers.push(Layer { name: name.clone(), channels });
                    WrittenCounts::Layer(name)
                }
            };
            let light_paths = step.counts.light_paths;
            written.push(WrittenStep { light_paths, camera_paths, rendered: step.rendered });
        }
        let text = serde_json::to_string(&written).expect("plain numbers and names");
        image.metadata.insert(ATTRIBUTE.into(), Value::Text(text));
    }

    /// Reads a plan that [`Self::write_to`] added.
    ///
    /// # Errors
    /// If there is no plan, or it is not valid.
    pub fn read_from(image: &Image) -> Result<Self> {
        let advice = "give an .exr file that `bdpm render` or `bdpm optimize` wrote";
        let Some(Value::Text(text)) = image.metadata.get(ATTRIBUTE) else {
            return Err(Error::new("this image holds no plan", advice));
        };
        let broken = |problem: String| Error::new(format!("the plan is broken: {problem}"), advice);
        let written: Vec<WrittenStep> =
            serde_json::from_str(text).map_err(|e| broken(e.to_string()))?;
        let step = |WrittenStep { light_paths, camera_paths, rendered }| {
            let camera_paths = match camera_paths {
                WrittenCounts::Uniform(count) => CameraCounts::Uniform(count),
                WrittenCounts::Layer(name) => {
                    let values = image.layer(&name).and_then(|layer| layer.channel("Y"));
                    let Some(values) = values else {
                        return Err(broken(format!("there is no layer {name}")));
                    };
                    let is_count = |&x: &f32| x.fract() == 0.0 && (1.0..=16_777_216.0).contains(&x);
                    if !values.iter().all(is_count) {
                        let problem = "holds values other than positive integers";
                        return Err(broken(format!("layer {name} {problem}")));
                    }
                    CameraCounts::PerPixel(values.iter().map(|&x| x as u32).collect())
                }
            };
            Ok(Step { counts: Counts { light_paths, camera_paths }, rendered })
        };
        let steps = written.into_iter().map(step).collect::<Result<Vec<_>>>()?;
        let plan = Self { steps };
        if !plan.is_consistent() {
            return Err(broken("iterations or weights are missing or not positive".into()));
        }
        Ok(plan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::math::Rgb;
    use bdpm_core::image_io::Metadata;

    fn image() -> Image {
        let layers = vec![Layer::rgb("", &[Rgb::ZERO; 4])];
        Image { width: 2, height: 2, layers, metadata: Metadata::default() }
    }

    fn plan() -> Plan {
        let camera_paths = CameraCounts::PerPixel(vec![1, 2, 3, 16_777_216]);
        let step = |counts, iterations, weight| Step {
            counts,
            rendered: Some(Rendered { iterations, weight }),
        };
        let second = Counts { light_paths: 7, camera_paths };
        Plan { steps: vec![step(Counts::uniform(5, 2), 8, 0.1 + 0.2), step(second, 90, 1.0)] }
    }

    #[test]
    fn plan_survives_writing_and_reading() {
        for plan in [plan(), Plan::new(Counts::uniform(3, 4))] {
            let mut image = image();
            plan.write_to(&mut image);
            assert_eq!(Plan::read_from(&image).unwrap(), plan);
        }
        assert_eq!(plan().iterations(), Some(98));
        assert_eq!(Plan::new(Counts::uniform(3, 4)).iterations(), None);
    }

    #[test]
    fn broken_plan_is_refused() {
        let refused = |image: &Image| Plan::read_from(image).unwrap_err().to_string();
        assert!(refused(&image()).contains("holds no plan"));
        for (text, expected) in [
            ("", "the plan is broken"),
            ("[]", "missing"),
            (r#"[{"light_paths":-1,"camera_paths":1}]"#, "broken"),
            (r#"[{"light_paths":1,"camera_paths":"plan0"}]"#, "no layer plan0"),
            (r#"[{"light_paths":1,"camera_paths":1,"iterations":0,"weight":1}]"#, "not positive"),
            (r#"[{"light_paths":1,"camera_paths":1,"iterations":1,"weight":-1}]"#, "not positive"),
            (
                r#"[{"light_paths":1,"camera_paths":1},{"light_paths":1,"camera_paths":1}]"#,
                "missing",
            ),
        ] {
            let mut image = image();
            image.metadata.insert(ATTRIBUTE.into(), Value::Text(text.into()));
            assert!(refused(&image).contains(expected), "{text}: {}", refused(&image));
        }
        let mut fractions = image();
        plan().write_to(&mut fractions);
        fractions.layers.last_mut().unwrap().channels[0].1[2] = 1.5;
        assert!(refused(&fractions).contains("other than positive integers"));
    }
}
