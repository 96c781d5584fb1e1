//! The command from outside, as a user has it. One executable, because each holds the whole program and is linked anew.

mod common;
mod faults;

mod animate;
mod annotate;
mod bad_footage;
mod bad_input;
mod bad_video;
mod check_captures;
mod check_faults;
mod farm;
mod held_out;
mod long_fit;
mod long_take;
mod markers;
mod mishaps;
mod new;
mod render;
mod report;
mod resume;
mod view;
