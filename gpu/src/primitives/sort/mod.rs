//! Stable radix sort of `u32` keys with one `u32` of payload, least significant digit first.
//!
//! The elements are cut into runs, one thread each. A thread counts the digits of its run into its
//! column of a table (digit by run), the table is scanned, and the thread then places its elements
//! in order. This is stable and needs no barrier, atomic or subgroup operation. The device reads
//! the number of elements from a buffer; elements beyond it cost nothing.
//!
//! With few threads, few runs and wide digits are fastest, since they need few passes. With many
//! threads it is the opposite ([`SortShape`]).

use crate::device::{Buffer, Gpu, GpuError, Tier};
use crate::primitives::scan::{Scan, ScanScratch};
use crate::shader::layout::{LONGEST_LOOP, SortArguments};
use crate::shader::{Access, Constant, Kernel, Recorder, Shader};

/// How a sort is spread over threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SortShape {
    /// Runs, at most.
    pub runs: u32,
    /// Threads per workgroup.
    pub group: u32,
    /// Bits of a digit, at most.
    pub bits: u32,
}

impl SortShape {
    /// For adapters with a handful of threads: two cores of eight lanes.
    pub const FEW_THREADS: Self = Self { runs: 16, group: 8, bits: 12 };
    /// For adapters with thousands.
    pub const MANY_THREADS: Self = Self { runs: 16_384, group: 64, bits: 5 };

    /// The shape of a tier: few threads on the processor, many on a GPU.
    pub fn of(tier: Tier) -> Self {
        match tier {
            Tier::Software => Self::of_this_machine(),
            Tier::Portable | Tier::Subgroup { .. } => Self::MANY_THREADS,
        }
    }

    /// As [`SortShape::FEW_THREADS`], for the processors of this machine.
    fn of_this_machine() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
        let runs = Self::FEW_THREADS.group * (cores as u32).clamp(2, 8);
        Self { runs, ..Self::FEW_THREADS }
    }

    /// Passes over keys of `bits` bits, and the bits that each takes; digits are the wider the more
    /// elements there may be, since the table of digits and runs must be scanned in each pass.
    fn passes(&self, bits: u32, capacity: usize) -> (u32, u32) {
        let rows = capacity / (2 * self.runs_for(capacity).max(1) as usize);
        let widest = rows.max(1).ilog2().clamp(self.bits.min(8), self.bits);
        let passes = bits.div_ceil(widest).max(1);
        (passes, bits.div_ceil(passes).max(1))
    }

    /// Runs for up to `capacity` elements: not too short, and none longer than [`LONGEST_LOOP`].
    fn runs_for(&self, capacity: usize) -> u32 {
        let whole_groups = |runs: usize| runs.next_multiple_of(self.group as usize) as u32;
        let most = whole_groups(capacity.div_ceil(16));
        self.runs.min(most).max(whole_groups(capacity.div_ceil(LONGEST_LOOP)))
    }
}

/// The kernels of a sort.
pub struct Sort {
    count: Kernel,
    place: Kernel,
    place_indices: Kernel,
    scan: Scan,
    shape: SortShape,
}

/// Keys and payloads of up to `capacity` elements, twice: a pass reads one side and writes the
/// other.
pub struct SortBuffers {
    /// Keys; the input is on side 0, the result on side [`SortBuffers::side`].
    pub keys: [Buffer<u32>; 2],
    /// Payload, likewise.
    pub values: [Buffer<u32>; 2],
    table: Buffer<u32>,
    scan: ScanScratch,
    runs: u32,
    bits: u32,
    passes: u32,
}

/// This kernel's shaders.
pub fn shaders(shape: SortShape) -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, text, indices, bindings| Shader {
        label,
        entry: "main",
        parts: vec![text],
        constants: vec![
            ("SORT_GROUP", Constant::U32(shape.group)),
            ("INDICES", Constant::Bool(indices)),
        ],
        bindings,
    };
    let place = include_str!("place.wgsl");
    let placed = vec![Read, Write, Read, Read, Write, Write];
    [
        shader("sort_count", include_str!("count.wgsl"), false, vec![Read, Read, Write]),
        shader("sort_place", place, false, placed.clone()),
        shader("sort_place_indices", place, true, placed),
    ]
}

impl SortBuffers {
    /// The side that holds the result of a sort.
    pub fn side(&self) -> usize {
        self.passes as usize % 2
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let sides = self.keys.iter().chain(&self.values);
        sides.map(|side| side.size()).sum::<u64>() + self.table.size()
    }
}

impl Sort {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with_shape(gpu, SortShape::of(gpu.tier()))
    }

    /// As [`Sort::new`], spread over threads as `shape` says.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn with_shape(gpu: &Gpu, shape: SortShape) -> Result<Self, GpuError> {
        let [count, place, indices] = shaders(shape);
        Ok(Self {
            count: Kernel::new(gpu, &count)?,
            place: Kernel::new(gpu, &place)?,
            place_indices: Kernel::new(gpu, &indices)?,
            scan: Scan::new(gpu)?,
            shape,
        })
    }

    /// The scan that the sort is built on.
    pub fn scan(&self) -> &Scan {
        &self.scan
    }

    /// Room for `capacity` elements with keys of `bits` bits.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn buffers(&self, gpu: &Gpu, capacity: usize, bits: u32) -> Result<SortBuffers, GpuError> {
        let side = |label| Buffer::new(gpu, label, capacity);
        let runs = self.shape.runs_for(capacity);
        let (passes, bits) = self.shape.passes(bits, capacity);
        let table = (runs as usize) << bits;
        Ok(SortBuffers {
            keys: [side("sort keys")?, side("sort keys")?],
            values: [side("sort values")?, side("sort values")?],
            table: Buffer::new(gpu, "sort table", table)?,
            scan: self.scan.scratch(gpu, table)?,
            runs,
            bits,
            passes,
        })
    }

    /// Sorts the first `count[0]` elements, no more than there is room for.
    pub fn sort(&self, recorder: &mut Recorder<'_>, buffers: &SortBuffers, count: &wgpu::Buffer) {
        self.passes(recorder, buffers, count, &self.place);
    }

    /// As [`Sort::sort`], with each element's place as its payload: returns where each sorted
    /// element was.
    pub fn sort_indices<'a>(
        &self,
        recorder: &mut Recorder<'_>,
        buffers: &'a SortBuffers,
        count: &wgpu::Buffer,
    ) -> &'a Buffer<u32> {
        self.passes(recorder, buffers, count, &self.place_indices);
        &buffers.values[buffers.side()]
    }

    fn passes(
        &self,
        recorder: &mut Recorder<'_>,
        buffers: &SortBuffers,
        count: &wgpu::Buffer,
        first: &Kernel,
    ) {
        let SortBuffers { keys, values, table, runs, bits, .. } = buffers;
        let groups = runs.div_ceil(self.shape.group);
        for pass in 0..buffers.passes {
            let (from, to) = (pass as usize % 2, 1 - pass as usize % 2);
            let arguments =
                SortArguments { runs: *runs, shift: pass * bits, bits: *bits, unused: 0 };
            recorder.dispatch(&self.count, &arguments, &[count, &keys[from], table], groups);
            self.scan.exclusive(recorder, table, table.len(), &buffers.scan);
            let sides: [&wgpu::Buffer; 6] =
                [count, table, &keys[from], &values[from], &keys[to], &values[to]];
            let place = if pass == 0 { first } else { &self.place };
            recorder.dispatch(place, &arguments, &sides, groups);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{LONGEST_LOOP, SortShape};

    #[test]
    fn no_run_is_longer_than_a_loop_may_be() {
        for shape in [SortShape::FEW_THREADS, SortShape::MANY_THREADS] {
            for capacity in [1, 1000, 1 << 20, 20_000_000] {
                let runs = shape.runs_for(capacity);
                assert!(capacity.div_ceil(runs as usize) <= LONGEST_LOOP, "{capacity}: {runs}");
                assert!(runs.is_multiple_of(shape.group));
            }
        }
    }

    #[test]
    fn passes_cover_all_bits_with_digits_that_fit() {
        for shape in [SortShape::FEW_THREADS, SortShape::MANY_THREADS] {
            for bits in 0..=32 {
                for capacity in [1, 1000, 100_000, 20_000_000] {
                    let (passes, digit) = shape.passes(bits, capacity);
                    assert!(passes * digit >= bits && digit <= shape.bits, "{bits}: {passes}");
                    assert!(passes >= 1 && digit >= 1);
                }
            }
        }
    }
}
