//! What the tracker needs per frame.

use lexsplat_gpu::{
    AlignSettings, Aligner, Estimate, Gaussians, Gpu, GpuError, Pyramids, Recorder, Renderer,
    Schedule,
};

use crate::{best, ms, scene};

/// Prints a table.
pub fn print(gpu: &Gpu) -> Result<(), GpuError> {
    let (width, height, levels) = (600, 340, 3);
    let camera = scene::camera(width, height);
    let mut gaussians = Gaussians::new(gpu, 1);
    gaussians.append(&scene::scene(50_000, 1))?;
    let mut renderer = Renderer::new(gpu, 1)?;
    let picture = renderer.render_color(&gaussians, &camera)?;
    let rgb: Vec<u8> = picture.rgb.iter().map(|v| (v * 255.0).clamp(0.0, 255.0) as u8).collect();
    let depth: Vec<f32> =
        picture.depth.iter().zip(&picture.opacity).map(|(d, o)| d / o.max(0.5)).collect();
    let (pyramids, mut aligner) = (Pyramids::new(gpu)?, Aligner::new(gpu)?);
    let mut live = pyramids.allocate(&camera, levels)?;
    let reference = pyramids.allocate(&camera, levels)?;
    println!("\ntracking, {width} x {height}, {levels} levels; ms");
    let fill = best(10, || {
        pyramids.fill(&mut live, &rgb, &depth)?;
        live.levels()[levels - 1].surface.read(gpu, 1).map(drop)
    })?;
    println!("{:>28} {:>7.2}", "pyramid of a frame", ms(fill));
    let render = best(5, || {
        let Some(drawn) = renderer.draw_color(&gaussians, &camera)? else { return Ok(()) };
        let mut recorder = Recorder::new(gpu)?;
        pyramids.fill_rendered(&mut recorder, &reference, drawn.image, drawn.pixels)?;
        recorder.submit();
        reference.levels()[levels - 1].surface.read(gpu, 1).map(drop)
    })?;
    println!("{:>28} {:>7.2}", "picture and its pyramid", ms(render));
    let start = Estimate::default();
    for level in 0..levels {
        let (reference, live) = (&reference.levels()[level], &live.levels()[level]);
        let settings = AlignSettings::default();
        let system = best(20, || aligner.system(reference, live, &start, &settings).map(drop))?;
        println!("{:>28} {:>7.2}", format!("normal system, level {level}"), ms(system));
    }
    let mut systems = 0;
    let align = best(5, || {
        systems = aligner.align(&reference, &live, &start, &Schedule::default())?.evaluations;
        Ok(())
    })?;
    println!("{:>28} {:>7.2}", format!("alignment, {systems} systems"), ms(align));
    Ok(())
}
