//! Stable radix sort of `u32` keys with one `u32` of payload, least significant digit first.
//!
//! A thread owns a run of [`SORT_RUN`] elements: it counts its digits into a table (digit by run),
//! the table is scanned, and the thread then places its elements in order. Stable without a
//! barrier. The number of elements is read on the device and may be below the capacity.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{ArrayArguments, DIGIT_BITS, DIGITS, SORT_RUN};
use crate::scan::{Scan, ScanScratch};
use crate::shader::{Access, GRID, Shader};

pub mod oracle;

/// The kernels of a sort.
pub struct Sort {
    count: Kernel,
    place: Kernel,
    scan: Scan,
}

/// Keys and payloads of up to `capacity` elements, twice: a pass reads one side and writes the
/// other.
pub struct SortBuffers {
    /// Keys; input and result are on side 0.
    pub keys: [Buffer<u32>; 2],
    /// Payload; input and result are on side 0.
    pub values: [Buffer<u32>; 2],
    table: Buffer<u32>,
    scan: ScanScratch,
    capacity: usize,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 2] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: Vec::new(),
        bindings,
    };
    let count = vec![GRID, include_str!("count.wgsl")];
    let place = vec![GRID, include_str!("place.wgsl")];
    [
        shader("sort_count", count, vec![Read, Read, Write]),
        shader("sort_place", place, vec![Read, Read, Read, Read, Write, Write]),
    ]
}

impl SortBuffers {
    /// Number of elements that fit.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}

impl Sort {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [count, place] = shaders();
        Ok(Self {
            count: Kernel::new(gpu, &count)?,
            place: Kernel::new(gpu, &place)?,
            scan: Scan::new(gpu)?,
        })
    }

    /// The scan that the sort is built on.
    pub fn scan(&self) -> &Scan {
        &self.scan
    }

    /// Room for `capacity` elements.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn buffers(&self, gpu: &Gpu, capacity: usize) -> Result<SortBuffers, GpuError> {
        let side = |label| Buffer::new(gpu, label, capacity);
        let table = DIGITS as usize * capacity.div_ceil(SORT_RUN as usize);
        Ok(SortBuffers {
            keys: [side("sort keys")?, side("sort keys")?],
            values: [side("sort values")?, side("sort values")?],
            table: Buffer::new(gpu, "sort table", table)?,
            scan: self.scan.scratch(gpu, table)?,
            capacity,
        })
    }

    /// Sorts the first `count[0]` elements by the low `bits` bits of their keys.
    pub fn sort(
        &self,
        recorder: &mut Recorder<'_>,
        buffers: &SortBuffers,
        count: &wgpu::Buffer,
        bits: u32,
    ) {
        let runs = buffers.capacity.div_ceil(SORT_RUN as usize);
        let passes = bits.div_ceil(DIGIT_BITS).next_multiple_of(2);
        for pass in 0..passes {
            let (from, to) = (pass as usize % 2, 1 - pass as usize % 2);
            let arguments = ArrayArguments { count: runs as u32, detail: pass * DIGIT_BITS };
            let (keys, values, table) = (&buffers.keys, &buffers.values, &buffers.table);
            recorder.dispatch_threads(&self.count, &arguments, &[count, &keys[from], table], runs);
            self.scan.exclusive(recorder, table, DIGITS as usize * runs, &buffers.scan);
            recorder.dispatch_threads(
                &self.place,
                &arguments,
                &[count, table, &keys[from], &values[from], &keys[to], &values[to]],
                runs,
            );
        }
    }
}
