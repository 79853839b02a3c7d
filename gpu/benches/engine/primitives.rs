//! Sort and scan by number of keys.

use lexsplat_gpu::primitives::sort::{Sort, SortShape};
use lexsplat_gpu::{Buffer, Gpu, GpuError, Recorder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{best, ms};

/// Prints a table.
pub fn print(gpu: &Gpu) -> Result<(), GpuError> {
    let sort = Sort::new(gpu)?;
    println!("\nsort of u32 keys with payload, scan of u32, ms ({:?})", SortShape::of(gpu.tier()));
    println!("{:>10} {:>9} {:>9} {:>9} {:>12}", "keys", "28 bits", "12 bits", "scan", "M keys/s");
    for len in [10_000, 100_000, 1_000_000, 10_000_000, 20_000_000] {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let keys: Vec<u32> = (0..len).map(|_| rng.random()).collect();
        let count = Buffer::from_slice(gpu, "count", &[len as u32])?;
        let mut times = Vec::new();
        for bits in [28, 12] {
            let buffers = sort.buffers(gpu, len, bits)?;
            buffers.keys[0].write(gpu, 0, &keys);
            times.push(best(3, || {
                let mut recorder = Recorder::new(gpu)?;
                sort.sort(&mut recorder, &buffers, &count);
                recorder.submit();
                count.read(gpu, 1).map(drop)
            })?);
        }
        let values = Buffer::<u32>::new(gpu, "values", len)?;
        let scratch = sort.scan().scratch(gpu, len)?;
        times.push(best(3, || {
            let mut recorder = Recorder::new(gpu)?;
            sort.scan().exclusive(&mut recorder, &values, len, &scratch);
            recorder.submit();
            count.read(gpu, 1).map(drop)
        })?);
        println!(
            "{len:>10} {:>9.2} {:>9.2} {:>9.2} {:>12.1}",
            ms(times[0]),
            ms(times[1]),
            ms(times[2]),
            len as f64 / times[0].as_secs_f64() / 1e6
        );
    }
    Ok(())
}
