//! All pairs of options of `bdpm render`: what is refused, and what does less than alone, is what
//! the table of combinations lists, and nothing else.

use super::render::{bdpm, folder, text};
use bdpm::settings::combinations::{COMBINATIONS, Combination, Outcome};
use rayon::prelude::*;
use std::path::Path;

/// Options that change the image or what is known of it, and those of parts.
const OPTIONS: &[&str] = &[
    "--strategy mis",
    "--strategy cut-mis",
    "--strategy path",
    "--strategy path-caustics",
    "--strategy gather",
    "--merge-vertex 1",
    "--splitting 4",
    "--sobol-set 32",
    "--light-paths 1000",
    "--light-paths 1",
    "--camera-paths 1",
    "--direct photon-map",
    "--bias reduce",
    "--radius 0.1",
    "--caustic-radius 0.1",
    "--kernel disc",
    "--guide 1",
    "--light-visibility 100",
    "--medium-scale 3",
    "--medium-share 0.5",
    "--medium-query points",
    "--wavelength-width 0.1",
    "--iterations 4",
    "--target-error 5%",
    "--target-rms 1%",
    "--noise n.exr",
    "--part 1/2",
    "--part 1/2 --checkpoint p.ckpt",
];

/// Options with files, whose conflicts the command line knows without reading them.
const FILES: &[&str] = &["--plan p.exr", "--resume r.ckpt", "--timings t.json"];

/// Scenes without a medium, and with one that scatters.
const SCENES: [(&str, bool); 2] = [("cornell-box-classic", false), ("smoke", true)];

/// A command line and its scene.
struct Case<'a> {
    options: Vec<&'a str>,
    scene: &'a str,
    scatters: bool,
}

impl Case<'_> {
    fn has(&self, name: &str) -> bool {
        self.options.iter().any(|option| option.split(' ').any(|word| word == name))
    }

    /// Tests whether path counts are chosen.
    fn is_automatic(&self) -> bool {
        !["--iterations", "--light-paths", "--camera-paths"].iter().any(|name| self.has(name))
    }

    /// Tests whether the case has a side of a combination.
    fn matches(&self, side: &str) -> bool {
        match side {
            "path counts that are chosen" => self.is_automatic(),
            "settings that are chosen" => true,
            "a strategy that is chosen" => self.is_automatic() && !self.has("--strategy"),
            "an open number of iterations" => !self.has("--iterations"),
            "no --checkpoint" => !self.has("--checkpoint"),
            "a medium that scatters" => self.scatters,
            "a scene without media that scatter" => !self.scatters,
            "a scene without dispersion" => true,
            "several processes" | "meters" => false,
            options => self.has_option(options),
        }
    }

    /// Tests for options such as `--strategy mis|cut-mis` and `--radius|--kernel`.
    fn has_option(&self, side: &str) -> bool {
        assert!(side.starts_with("--"), "no such state of a render: {side}");
        let mut name = "";
        side.split('|').any(|alternative| {
            let (first, value) = match alternative.split_once(' ') {
                Some((first, value)) => (first, Some(value)),
                None if alternative.starts_with("--") => (alternative, None),
                None => (name, Some(alternative)),
            };
            name = first;
            self.options.iter().any(|option| match value {
                Some(value) => *option == format!("{name} {value}"),
                None => option.split(' ').any(|word| word == name),
            })
        })
    }

    fn rows(&self) -> impl Iterator<Item = &'static Combination> {
        let both = |row: &&Combination| {
            let [first, second] = row.options;
            // The scene with a medium gives the merge vertex 1.
            let by_scene =
                self.scatters && first == "--strategy mis|cut-mis" && second == "--merge-vertex";
            self.matches(first) && (by_scene || self.matches(second))
        };
        COMBINATIONS.iter().filter(both)
    }

    /// What is wrong with the answer of the program.
    fn problem(&self, folder: &Path) -> Option<String> {
        let scene = format!("{}/scenes/{}", env!("CARGO_MANIFEST_DIR"), self.scene);
        let mut command = bdpm(&["render", &scene, "--dry-run", "--verbose", "--accel", "bvh"]);
        command.current_dir(folder).args(["--resolution", "24x18"]);
        command.args(self.options.iter().flat_map(|option| option.split(' ')));
        let output = command.output().unwrap();
        let (code, shown) = (output.status.code(), text(&output.stderr));
        let is = |outcome: fn(&Outcome) -> bool| self.rows().any(|row| outcome(&row.outcome));
        let expected = if is(|outcome| matches!(outcome, Outcome::Usage(_))) {
            2
        } else if is(|outcome| matches!(outcome, Outcome::Refused(_))) {
            1
        } else {
            0
        };
        let title = format!("{} {}", self.scene, self.options.join(" "));
        // Files of options do not exist.
        let is_unread = FILES.iter().any(|file| self.options.contains(file));
        if is_unread {
            return ((expected == 2) != (code == Some(2))).then(|| format!("{title}: {shown}"));
        }
        if code != Some(expected) {
            return Some(format!("{title}: exit code {code:?} instead of {expected}: {shown}"));
        }
        let weakened = self.rows().filter(|row| matches!(row.outcome, Outcome::Weakened));
        let notes: Vec<String> = weakened.map(|row| format!("note: {row}")).collect();
        let found: Vec<&str> = shown.lines().filter(|line| line.starts_with("note: ")).collect();
        (code == Some(0) && found != notes).then(|| format!("{title}: {found:#?} not {notes:#?}"))
    }
}

fn name(option: &str) -> &str {
    option.split(' ').next().unwrap()
}

#[test]
fn pairs_of_options_do_what_the_table_lists() {
    let (folder, _) = folder();
    let mut cases = Vec::new();
    let all: Vec<&str> = OPTIONS.iter().chain(FILES).copied().collect();
    for (i, &first) in all.iter().enumerate() {
        let (scene, scatters) = SCENES[0];
        cases.push(Case { options: vec![first], scene, scatters });
        let others = all[i + 1..].iter().filter(|second| name(second) != name(first));
        cases.extend(others.map(|&second| Case { options: vec![first, second], scene, scatters }));
    }
    let (scene, scatters) = SCENES[1];
    cases.extend(OPTIONS.iter().map(|&option| Case { options: vec![option], scene, scatters }));
    let problems: Vec<String> =
        cases.par_iter().filter_map(|case| case.problem(folder.path())).collect();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
