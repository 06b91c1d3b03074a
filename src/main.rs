//! The command-line program `bdpm`.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
