//! `bdpm completions SHELL` and `bdpm man DIR`: files for the shell and the manual, made from the
//! definitions of the options.

use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct CompletionsArgs {
    /// Print completions for this shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

#[derive(clap::Args)]
pub struct ManArgs {
    /// Write bdpm.1 and a page for each subcommand to this folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// The completions of a shell.
pub fn completions(args: &CompletionsArgs, mut command: Command) -> String {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "bdpm", &mut script);
    String::from_utf8_lossy(&script).into_owned()
}

/// Writes the manual pages, and returns their names.
pub fn manual(args: &ManArgs, mut command: Command) -> Result<String> {
    let folder = &args.folder;
    fs::create_dir_all(folder).map_err(|e| Error::io("create the folder", folder, e))?;
    // Propagates the version and full names to the subcommands
    command.build();
    let mut written = write_page(folder, &command, "bdpm")?;
    for subcommand in command.get_subcommands().filter(|command| command.get_name() != "help") {
        let name = format!("bdpm-{}", subcommand.get_name());
        written += &write_page(folder, subcommand, &name)?;
    }
    Ok(written)
}

fn write_page(folder: &Path, command: &Command, name: &str) -> Result<String> {
    let path = folder.join(format!("{name}.1"));
    // Pages describe all options, also those that `-h` leaves out, and need no reference to
    // `--help`
    let command = command.clone().mut_args(|argument| argument.hide_short_help(false));
    let command = command.after_help(None::<&'static str>).after_long_help(None::<&'static str>);
    let page = Man::new(command).title(name).manual("bdpm");
    write_atomically(&path, |to| page.render(to))?;
    Ok(format!("{}\n", path.display()))
}
