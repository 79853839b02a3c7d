//! Whether an adapter keeps its word: tiny kernels for what a tier relies on, compared with the
//! host. In: a device and a tier; out: nothing, or which check failed and how.
//!
//! Integers below 2^24 throughout, so that every comparison is exact, floats included.

use super::Gpu;
use super::tier::Tier;
use crate::buffer::Buffer;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{ArrayArguments, GROUP};
use crate::shader::{Access, GRID, Shader};

/// Threads of a check: several workgroups.
const THREADS: usize = 5 * GROUP as usize;
/// Values that a thread of the subgroup check leaves.
const SUBGROUP_VALUES: usize = 5;
/// Slots over which the atomic check's threads compete.
const SLOTS: usize = 7;

/// Changes the results of a check, by name, before they are compared; only a test of the fall-back
/// changes anything.
pub(super) type Tamper<'a> = &'a dyn Fn(&'static str, &mut [u32]);

/// The shaders of the checks: workgroup memory, atomics, and with `subgroups` subgroup operations.
pub fn shaders(subgroups: bool) -> Vec<Shader> {
    let shader = |label, text| Shader {
        label,
        entry: "main",
        parts: vec![GRID, text],
        constants: Vec::new(),
        bindings: vec![Access::Read, Access::Write],
    };
    let mut shaders = vec![
        shader("check_memory", include_str!("memory.wgsl")),
        shader("check_atomics", include_str!("atomics.wgsl")),
    ];
    if subgroups {
        shaders.push(shader("check_subgroups", include_str!("subgroups.wgsl")));
    }
    shaders
}

/// Runs every check of a tier on a fresh device.
pub(super) fn run(gpu: &Gpu, tier: Tier, tamper: Tamper<'_>) -> Result<(), String> {
    // The finaliser of a hash: neighbours differ, all below 2^16.
    let values: Vec<u32> =
        (1..=THREADS as u32).map(|i| i.wrapping_mul(0x9e37_79b1) >> 16).collect();
    for shader in shaders(tier.subgroup().is_some()) {
        let (len, check): (usize, Check) = match shader.label {
            "check_memory" => (THREADS, Box::new(memory)),
            "check_atomics" => (SLOTS, Box::new(atomics)),
            _ => {
                let lanes = tier.subgroup().unwrap_or_default();
                (SUBGROUP_VALUES * THREADS, Box::new(move |v, found| subgroups(lanes, v, found)))
            }
        };
        let mut found = measure(gpu, &shader, &values, len)
            .map_err(|error| format!("{}: {error}", shader.label))?;
        tamper(shader.label, &mut found);
        check(&values, &found).map_err(|why| format!("{}: {why}", shader.label))?;
    }
    Ok(())
}

type Check = Box<dyn Fn(&[u32], &[u32]) -> Result<(), String>>;

fn measure(gpu: &Gpu, shader: &Shader, values: &[u32], len: usize) -> Result<Vec<u32>, GpuError> {
    let kernel = Kernel::new(gpu, shader)?;
    let given = Buffer::from_slice(gpu, "self-test in", values)?;
    let found = Buffer::<u32>::new(gpu, "self-test out", len)?;
    let arguments = ArrayArguments { count: values.len() as u32, detail: SLOTS as u32 };
    let mut recorder = Recorder::new(gpu)?;
    recorder.dispatch_threads(&kernel, &arguments, &[&given, &found], values.len());
    recorder.submit();
    found.read(gpu, len)
}

fn expect(what: &str, at: usize, expected: u32, found: u32) -> Result<(), String> {
    if expected == found {
        return Ok(());
    }
    Err(format!("{what} at {at}: expected {expected}, found {found}"))
}

/// Each workgroup's values in reverse, plus their sum.
fn memory(values: &[u32], found: &[u32]) -> Result<(), String> {
    let groups = values.chunks(GROUP as usize).zip(found.chunks(GROUP as usize));
    for (values, found) in groups {
        let sum: u32 = values.iter().sum();
        for (lane, (mirrored, found)) in values.iter().rev().zip(found).enumerate() {
            expect("workgroup memory", lane, mirrored + sum, *found)?;
        }
    }
    Ok(())
}

/// The largest value of each slot.
fn atomics(values: &[u32], found: &[u32]) -> Result<(), String> {
    for (slot, found) in found.iter().enumerate() {
        let most = values.iter().skip(slot).step_by(SLOTS).max().copied().unwrap_or_default();
        expect("atomic maximum", slot, most, *found)?;
    }
    Ok(())
}

/// Size, lane, sum, broadcast of lane 0 and of lane 3 as floats: five values per thread. There are
/// at least four lanes.
fn subgroups((min, max): (u32, u32), values: &[u32], found: &[u32]) -> Result<(), String> {
    let size = found[0];
    if !size.is_power_of_two() || !(min..=max).contains(&size) {
        return Err(format!(
            "subgroup size: expected a power of two, {min} to {max}, found {size}"
        ));
    }
    let lanes = size.min(GROUP) as usize;
    let rows = found.chunks(SUBGROUP_VALUES * lanes);
    for (group, (values, rows)) in values.chunks(lanes).zip(rows).enumerate() {
        let sum: u32 = values.iter().sum();
        for (lane, row) in rows.chunks(SUBGROUP_VALUES).enumerate() {
            let at = group * lanes + lane;
            expect("subgroup size", at, size, row[0])?;
            expect("lane", at, lane as u32, row[1])?;
            expect("subgroup sum", at, sum, row[2])?;
            expect("first lane's value", at, values[0], row[3])?;
            expect("fourth lane's value", at, values[3], row[4])?;
        }
    }
    Ok(())
}
