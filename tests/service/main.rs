//! A server with everything in it, and its clients.

mod backpressure;
mod backup;
mod bad_input;
mod budget;
mod bundles;
mod clock;
mod end_to_end;
mod evaluate;
mod examples;
mod exports;
mod faults;
mod input_check;
mod labels;
mod load;
mod memory;
mod outside;
mod reads;
mod restart;
mod shutdown;
mod tracking;
mod wide_steps;
