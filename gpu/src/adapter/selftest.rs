//! Self-test of a device: small kernels use each feature of a tier, and their results are compared
//! with the host's.
//!
//! All numbers are integers below 2^24, so that every comparison is exact, floats included.

use crate::device::{Buffer, Gpu, GpuError, Tier};
use crate::shader::layout::{ArrayArguments, GROUP};
use crate::shader::{Access, Constant, GRID, Kernel, Recorder, Shader};

/// Threads of a check: several workgroups, whatever their size.
const THREADS: usize = 6 * GROUP as usize;
/// Values that a thread of the subgroup check leaves.
const SUBGROUP_VALUES: usize = 6;

/// Changes the results of a check, by name, before they are compared; only a test of the fall-back
/// changes anything.
pub(super) type Tamper<'a> = &'a dyn Fn(&'static str, &mut [u32]);

/// The shaders of a tier's checks: workgroup memory, and subgroup operations where it has them.
pub fn shaders(tier: Tier) -> Vec<Shader> {
    let shader = |label, text, width| Shader {
        label,
        entry: "main",
        parts: vec![GRID, text],
        constants: vec![("WIDTH", Constant::U32(width))],
        bindings: vec![Access::Read, Access::Write],
    };
    let mut shaders = vec![shader("check_memory", include_str!("memory.wgsl"), GROUP)];
    if tier.subgroup().is_some() {
        let width = workgroup(tier);
        shaders.push(shader("check_subgroups", include_str!("subgroups.wgsl"), width));
    }
    shaders
}

/// Threads per workgroup of the subgroup check: one subgroup, as the kernels have it, if the size
/// is fixed.
fn workgroup(tier: Tier) -> u32 {
    tier.subgroup().filter(|(min, max)| min == max).map_or(GROUP, |(lanes, _)| lanes)
}

/// Runs every check of a tier on a fresh device.
pub(super) fn run(gpu: &Gpu, tier: Tier, tamper: Tamper<'_>) -> Result<(), String> {
    // The finaliser of a hash: neighbours differ, all below 2^16.
    let values: Vec<u32> =
        (1..=THREADS as u32).map(|i| i.wrapping_mul(0x9e37_79b1) >> 16).collect();
    for shader in shaders(tier) {
        let (width, per_thread, check): (u32, usize, Check) = match shader.label {
            "check_memory" => (GROUP, 1, Box::new(memory)),
            _ => {
                let ((min, max), width) = (tier.subgroup().unwrap_or_default(), workgroup(tier));
                let check: Check = Box::new(move |v, found| subgroups(min, max, width, v, found));
                (width, SUBGROUP_VALUES, check)
            }
        };
        let mut found = measure(gpu, &shader, &values, width, per_thread * THREADS)
            .map_err(|error| format!("{}: {error}", shader.label))?;
        tamper(shader.label, &mut found);
        check(&values, &found).map_err(|why| format!("{}: {why}", shader.label))?;
    }
    Ok(())
}

type Check = Box<dyn Fn(&[u32], &[u32]) -> Result<(), String>>;

fn measure(
    gpu: &Gpu,
    shader: &Shader,
    values: &[u32],
    width: u32,
    len: usize,
) -> Result<Vec<u32>, GpuError> {
    let kernel = Kernel::new(gpu, shader)?;
    let given = Buffer::from_slice(gpu, "self-test in", values)?;
    let found = Buffer::<u32>::new(gpu, "self-test out", len)?;
    let arguments = ArrayArguments { count: values.len() as u32, detail: 0 };
    let mut recorder = Recorder::new(gpu)?;
    let groups = (values.len() as u32).div_ceil(width);
    recorder.dispatch(&kernel, &arguments, &[&given, &found], groups);
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

/// Size, lane, largest value, sum by exchange, and the values of lane 0 and of the mirrored lane,
/// as floats: the features that shared/lanes_subgroup.wgsl uses.
fn subgroups(min: u32, max: u32, width: u32, values: &[u32], found: &[u32]) -> Result<(), String> {
    let size = found[0];
    if !size.is_power_of_two() || !(min..=max).contains(&size) {
        return Err(format!(
            "subgroup size: expected a power of two, {min} to {max}, found {size}"
        ));
    }
    let lanes = size.min(width) as usize;
    let rows = found.chunks(SUBGROUP_VALUES * lanes);
    for (group, (values, rows)) in values.chunks(lanes).zip(rows).enumerate() {
        let sum = values.iter().sum();
        let most = values.iter().max().copied().unwrap_or_default();
        let mirrored = values.iter().rev();
        for (lane, (row, mirror)) in rows.chunks(SUBGROUP_VALUES).zip(mirrored).enumerate() {
            let at = group * lanes + lane;
            expect("subgroup size", at, size, row[0])?;
            expect("lane", at, lane as u32, row[1])?;
            expect("largest value", at, most, row[2])?;
            expect("sum by exchange", at, sum, row[3])?;
            expect("first lane's value", at, values[0], row[4])?;
            expect("mirrored lane's value", at, *mirror, row[5])?;
        }
    }
    Ok(())
}
