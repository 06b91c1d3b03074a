//! Every `sh` block of the documentation runs, at small sizes. The blocks of one page share a
//! folder, so that later ones may use files of earlier ones. Blocks marked `sh not-run` need a
//! network, other programs or hours: only the options of their `bdpm` commands are checked.

use super::help::help;
use super::markdown::{Block, Page, files, pages, root};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread;

/// Stands for `bdpm` in the blocks: runs it at small sizes.
const SMALL_BDPM: &str = include_str!("small-bdpm.sh");
/// Stands for `make`, `cargo`, scripts and others in the blocks: checks that targets and files
/// exist.
const CHECK_NAMES: &str = include_str!("check-names.sh");

/// All subcommands: `claims.rs` compares them with the program.
pub const SUBCOMMANDS: [&str; 19] = [
    "render",
    "measure",
    "daylight",
    "merge",
    "mix",
    "denoise",
    "tone",
    "compare",
    "info",
    "convert",
    "glare",
    "goniometer",
    "analyze",
    "predict",
    "calibrate",
    "optimize",
    "reproduce",
    "completions",
    "man",
];

fn is_shell(block: &Block) -> bool {
    block
        .info
        .split_whitespace()
        .next()
        .is_some_and(|language| ["sh", "console"].contains(&language))
}

fn is_run(block: &Block) -> bool {
    is_shell(block) && !block.info.contains("not-run")
}

fn write_program(path: &Path, text: &str) {
    fs::write(path, text).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

/// A folder that looks like the repository to the blocks, with stand-ins for programs and scripts.
fn working_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["scenes", "tests", "examples", "benches", "docs", "Makefile"] {
        symlink(root().join(name), at(name)).unwrap();
    }
    for name in ["bin", "scripts", "out"] {
        fs::create_dir(at(name)).unwrap();
    }
    write_program(&at("bin/bdpm"), SMALL_BDPM);
    for name in ["make", "cargo", "blender"] {
        write_program(&at("bin").join(name), CHECK_NAMES);
    }
    for script in files("scripts") {
        write_program(&at(script.to_str().unwrap()), CHECK_NAMES);
    }
    folder
}

/// Runs the blocks of a page. Returns the problems.
fn run(page: &Page) -> Vec<String> {
    let folder = working_folder();
    let inherited = std::env::var("PATH").unwrap();
    let path = format!("{}:{inherited}", folder.path().join("bin").display());
    let mut problems = Vec::new();
    for block in page.blocks().iter().filter(|block| is_run(block)) {
        let mut command = Command::new("bash");
        command.args(["-euo", "pipefail", "-c", &block.text]).current_dir(folder.path());
        command.env("PATH", &path).env("BDPM_PROGRAM", env!("CARGO_BIN_EXE_bdpm"));
        let output = command.env("RAYON_NUM_THREADS", "1").stdin(Stdio::null()).output().unwrap();
        if !output.status.success() {
            let shown = String::from_utf8_lossy(&output.stderr).into_owned();
            problems.push(format!("{}:{}: {shown}", page.path.display(), block.line));
        }
    }
    problems
}

#[test]
fn commands_run() {
    let pages: Vec<Page> =
        pages().into_iter().filter(|page| page.blocks().iter().any(is_run)).collect();
    assert!(pages.len() > 10, "there are too few pages with commands");
    let (left, problems) = (Mutex::new(pages), Mutex::new(Vec::new()));
    let threads = thread::available_parallelism().map_or(2, usize::from).min(8);
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some(page) = { left.lock().unwrap().pop() } {
                    let found = run(&page);
                    problems.lock().unwrap().extend(found);
                }
            });
        }
    });
    let problems = problems.into_inner().unwrap();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

/// The subcommand and the options of each `bdpm` command in `text`.
fn commands(text: &str) -> Vec<(String, Vec<String>)> {
    let joined = text.replace("\\\n", " ");
    let mut found = Vec::new();
    for line in joined.lines() {
        let line = line.split(" #").next().unwrap();
        let words: Vec<&str> = line.split_whitespace().collect();
        for (at, two) in words.windows(2).enumerate() {
            let is_bdpm = two[0] == "bdpm" || two[0].ends_with("/bdpm");
            if !is_bdpm || !SUBCOMMANDS.contains(&two[1]) {
                continue;
            }
            let own =
                words[at + 2..].iter().take_while(|word| !["|", ";", "&&", "&"].contains(word));
            let options = own.filter(|word| word.starts_with("--"));
            let name = |word: &&str| word.split('=').next().unwrap().to_owned();
            found.push((two[1].to_owned(), options.map(name).collect()));
        }
    }
    found
}

/// Whether a help text lists an option.
fn lists(help: &str, option: &str) -> bool {
    help.match_indices(option).any(|(start, _)| {
        let after = help[start + option.len()..].chars().next();
        after.is_none_or(|c| !c.is_ascii_alphanumeric() && c != '-')
    })
}

#[test]
fn options_of_commands_that_do_not_run_exist() {
    let help: BTreeMap<_, _> = SUBCOMMANDS.into_iter().map(|name| (name, help(name))).collect();
    let mut problems = Vec::new();
    for page in pages() {
        let blocks = page.blocks();
        let shell = blocks.iter().filter(|block| is_shell(block) && !is_run(block));
        let mut texts: Vec<(usize, &str)> =
            shell.map(|block| (block.line, &block.text[..])).collect();
        texts.extend(page.inline_code());
        for (line, text) in texts {
            for (subcommand, options) in commands(text) {
                for option in options.iter().filter(|option| !lists(&help[&subcommand[..]], option))
                {
                    let place = format!("{}:{line}", page.path.display());
                    problems.push(format!("{place}: `{subcommand}` has no option {option}"));
                }
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn unknown_options_and_failing_commands_are_noticed() {
    let found =
        commands("srun -n 2 bdpm render a.toml \\\n  --time=3s --nothing # --comment\nbdpm x --y");
    assert_eq!(found, [("render".into(), vec!["--time".into(), "--nothing".into()])]);
    assert!(lists(&help("render"), "--time") && !lists(&help("render"), "--tim"));
    let failing = [
        "bdpm render scenes/nowhere --output a.exr",
        "make nothing",
        "scripts/no.sh",
        "scripts/mitsuba-check.sh scenes/nowhere.xml",
    ];
    for command in failing {
        let text = format!("```sh\n{command}\n```\n");
        let problems = run(&Page { path: "p.md".into(), text });
        assert_eq!(problems.len(), 1, "{command}");
    }
}
