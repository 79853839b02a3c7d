//! Heads that share parameters: one value, and the gradients of both add up.

use crate::support;
use crate::training::{DATA, Targets, map};

use lexsplat_gpu::{HostGaussians, LearningRates, Ties, Trainer};

#[test]
fn tied_parameters_stay_equal_and_add_their_gradients() {
    let gpu = support::gpu();
    let mut scene = support::scene(9, 80, 15, 0.12);
    scene.language.rotations.clone_from(&scene.color.rotations);
    scene.language.log_scales.clone_from(&scene.color.log_scales);
    scene.language.opacity_logits.clone_from(&scene.color.opacity_logits);
    let targets = Targets::new(&gpu, &support::scene(10, 80, 15, 0.12));
    let steps = |ties: Ties, views: &[(bool, bool)]| {
        let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
        trainer.set_ties(ties);
        let mut gaussians = map(&gpu, &scene);
        for (color, language) in views {
            let view = targets.view(*color, *language);
            trainer.step(&mut gaussians, &view, &DATA, &LearningRates::default()).expect("steps");
        }
        trainer.settle(&mut gaussians).expect("settles");
        gaussians.to_host().expect("reads")
    };
    let views = [(true, true), (true, false), (false, true), (true, true)];
    for (rotation, scale, opacity) in
        [(true, true, true), (true, false, false), (false, true, false), (false, false, true)]
    {
        let found = steps(Ties { rotation, scale, opacity }, &views);
        let (c, l) = (&found.color, &found.language);
        assert_eq!(c.rotations == l.rotations, rotation);
        assert_eq!(c.log_scales == l.log_scales, scale);
        assert_eq!(c.opacity_logits == l.opacity_logits, opacity);
        assert_ne!(c.opacity_logits, scene.color.opacity_logits, "they learn");
    }
    let tied = Ties { rotation: true, scale: true, opacity: true };
    let alone = steps(tied, &[(false, true)]);
    assert_ne!(alone.color.opacity_logits, scene.color.opacity_logits, "language moves both");
    assert_eq!((&alone.means, &alone.color.features), (&scene.means, &scene.color.features));
    // One step with both heads moves by the sign of the summed gradient (Adam's first step).
    let both = steps(tied, &[(true, true)]);
    let gradients = |color: bool| -> Vec<f32> {
        let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
        let mut gaussians = map(&gpu, &scene);
        let rates = LearningRates::default();
        trainer.step(&mut gaussians, &targets.view(color, !color), &DATA, &rates).expect("steps");
        trainer.settle(&mut gaussians).expect("settles");
        let host = gaussians.to_host().expect("reads");
        let head = if color { host.color } else { host.language };
        let start = &scene.color.opacity_logits;
        head.opacity_logits.iter().zip(start).map(|(after, before)| after - before).collect()
    };
    let moves = |host: &HostGaussians| -> Vec<f32> {
        let start = &scene.color.opacity_logits;
        host.color.opacity_logits.iter().zip(start).map(|(a, b)| a - b).collect()
    };
    let (by_color, by_language, by_both) = (gradients(true), gradients(false), moves(&both));
    let agree = (0..80).filter(|i| by_color[*i] * by_language[*i] > 0.0).collect::<Vec<_>>();
    assert!(agree.len() > 5 && agree.iter().all(|i| by_both[*i] * by_color[*i] > 0.0));
    let follow = |one: &[f32]| (0..80).filter(|i| by_both[*i] * one[*i] < 0.0).count();
    assert!(follow(&by_color) > 0 && follow(&by_language) > 0, "neither head decides alone");
}
