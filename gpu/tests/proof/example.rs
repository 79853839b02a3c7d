//! The example of one kernel alone runs and is right.

use crate::support;

#[path = "../../examples/kernel_alone.rs"]
mod kernel_alone;

#[test]
fn a_kernel_alone_sums_squares() {
    let gpu = support::gpu();
    let found = kernel_alone::sums_of_squares(&gpu, &[1, 2, 3, 4, 5]).expect("runs");
    assert_eq!(found, [0, 1, 5, 14, 30]);
    kernel_alone::main().expect("runs");
}
