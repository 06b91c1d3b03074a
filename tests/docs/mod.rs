//! The documentation: its links, its commands, its claims, its numbers, and its copy of the help
//! texts.

mod claims;
mod combinations;
mod commands;
mod formats;
mod help;
mod library;
mod limits;
mod links;
mod markdown;
mod pictures;
mod readme;
mod site;
mod sources;
mod theory;
