//! The documentation: its links, its commands, and its copy of the help texts.

mod commands;
mod help;
mod links;
mod markdown;
mod sources;
