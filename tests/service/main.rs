//! A server with everything in it, and its clients.

mod backpressure;
mod bad_input;
mod bundles;
mod end_to_end;
mod evaluate;
mod outside;
mod shutdown;
mod tracking;
