//! A server with everything in it, and its clients.

mod backpressure;
mod bad_input;
mod end_to_end;
mod evaluate;
mod labels;
mod outside;
mod shutdown;
mod tracking;
