//! The documentation: its links, its commands, its claims, and its copy of the help texts.

mod claims;
mod combinations;
mod commands;
mod help;
mod limits;
mod links;
mod markdown;
mod sources;
