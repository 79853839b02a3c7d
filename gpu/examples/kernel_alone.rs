//! A kernel alone: writes one WGSL kernel, runs it, and adds up its result with a kernel of the
//! crate.
//!
//! `cargo run -p lexsplat-gpu --example kernel_alone`

use lexsplat_gpu::primitives::scan::Scan;
use lexsplat_gpu::shader::layout::ArrayArguments;
use lexsplat_gpu::shader::{Access, GRID, Kernel, Recorder, Shader};
use lexsplat_gpu::{Buffer, Gpu, GpuError};

/// The kernel: `squares[i] = values[i]²`.
///
/// The header that comes before it defines `ArrayArguments` and `GROUP`, the threads per workgroup.
/// `linear_thread` is in [`GRID`]. There may be more threads than elements.
const SQUARE: &str = "
@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> squares: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = linear_thread(group, groups, lane);
    if i >= arguments.count { return; }
    squares[i] = values[i] * values[i];
}
";

/// For each value, the sum of the squares of all values before it.
pub fn sums_of_squares(gpu: &Gpu, values: &[u32]) -> Result<Vec<u32>, GpuError> {
    // A shader lists its WGSL parts and how it uses each storage buffer, from binding 1 on.
    let shader = Shader {
        label: "square",
        entry: "main",
        parts: vec![GRID, SQUARE],
        constants: Vec::new(),
        bindings: vec![Access::Read, Access::Write],
    };
    let square = Kernel::new(gpu, &shader)?;
    let scan = Scan::new(gpu)?;

    let input = Buffer::from_slice(gpu, "values", values)?;
    let output = Buffer::<u32>::new(gpu, "squares", values.len())?;
    let scratch = scan.scratch(gpu, values.len())?;

    // A recorder collects dispatches. Each one sees what the ones before it wrote.
    let mut recorder = Recorder::new(gpu)?;
    let arguments = ArrayArguments { count: values.len() as u32, detail: 0 };
    recorder.dispatch_threads(&square, &arguments, &[&input, &output], values.len());
    scan.exclusive(&mut recorder, &output, values.len(), &scratch);
    recorder.submit();

    // Reading waits for the device.
    output.read(gpu, values.len())
}

/// Prints the adapter, the values and the sums.
pub fn main() -> Result<(), GpuError> {
    let gpu = Gpu::new(None)?;
    let values: Vec<u32> = (1..=8).collect();
    println!("adapter: {} ({})", gpu.adapter_name(), gpu.tier().name());
    println!("values: {values:?}");
    println!("sums of the squares before each: {:?}", sums_of_squares(&gpu, &values)?);
    Ok(())
}
