//! A server with everything in it, and its clients.

mod access;
mod attacks;
mod backpressure;
mod backup;
mod bad_input;
mod browser;
mod budget;
mod bundles;
mod clock;
mod connections;
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
mod tls;
mod tracking;
mod wide_steps;
