//! Policy files: golden policies, wrong files, and games that policies play.

mod files;
mod fitting;
mod fuzz;
mod golden;
mod playing;
