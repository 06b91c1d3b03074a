//! The paper's experiment repeated: measured here, and put beside the published values.
//!
//! [`part`] lists what is measured, [`run`] measures it and can be stopped at any time,
//! [`folder`] keeps it. [`results`] makes the figures and tables of the paper out of that,
//! [`comparisons`] find out what is the same, and [`report`] shows all in one HTML file. What the
//! paper says by itself is in [`implied`].

pub mod comparisons;
pub mod estimators;
pub mod findings;
pub mod folder;
pub mod implied;
pub mod optimum;
pub mod part;
pub mod published;
pub mod report;
pub mod results;
pub mod run;
pub mod table_2;
pub mod tables;
pub mod terms;
