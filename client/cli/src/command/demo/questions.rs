//! The choice of the five questions of the demo. With ground-truth masks, each question comes with
//! the frame that shows its object best.

use crate::dataset::DatasetSpec;
use lexsplat_client::dataset::{Instance, Mask};
use std::cmp::Reverse;
use std::collections::HashMap;

/// Number of questions.
pub const QUESTIONS: usize = 5;
/// Share of a frame that an object fills if it is seen well.
const SALIENT_SHARE: f64 = 0.01;
/// So many pixels of an object that the border of the image cuts off count as one.
const CUT: usize = 4;
/// Keyframes that are tried for a question without ground truth.
const TRIED_FRAMES: usize = 8;

/// Classes that are asked for first if they are seen well: objects that people look for.
const PREFERRED: [&str; 16] = [
    "sofa",
    "chair",
    "potted plant",
    "laptop",
    "lamp",
    "television",
    "bookcase",
    "table",
    "teddy bear",
    "bed",
    "door",
    "bottle",
    "bowl",
    "stool",
    "picture",
    "window",
];
const IN_SEVEN_SCENES: [&str; QUESTIONS] = ["chair", "table", "cup", "book", "screen"];
const ANYWHERE: [&str; QUESTIONS] = ["sofa", "chair", "table", "lamp", "potted plant"];

/// The frame that shows a class best.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sight {
    /// The class.
    pub class: String,
    /// Position of the frame in the data set.
    pub index: usize,
    /// Pixels of the class in it; those of cut-off objects count a quarter.
    pub pixels: usize,
    /// Number of pixels of the frame.
    pub of: usize,
}

impl Sight {
    fn is_salient(&self) -> bool {
        self.pixels as f64 >= SALIENT_SHARE * self.of as f64
    }
}

/// Adds the mask of a frame: keeps for each class the frame with most pixels, the first of equals.
pub fn look(sights: &mut Vec<Sight>, instances: &[Instance], index: usize, mask: &Mask) {
    let (width, height) = (mask.width as usize, mask.height as usize);
    // For each instance: its pixels, and whether it touches the border.
    let mut seen: HashMap<u16, (usize, bool)> = HashMap::new();
    for (at, id) in mask.ids.iter().enumerate() {
        let (row, column) = (at / width, at % width);
        let border = row == 0 || column == 0 || row + 1 == height || column + 1 == width;
        let (pixels, cut) = seen.entry(*id).or_default();
        *pixels += 1;
        *cut |= border;
    }
    let mut of_class: HashMap<&str, usize> = HashMap::new();
    for instance in instances {
        if let Some(&(pixels, cut)) = seen.get(&instance.id) {
            *of_class.entry(&instance.class).or_default() +=
                if cut { pixels.div_ceil(CUT) } else { pixels };
        }
    }
    for (class, pixels) in of_class {
        let sight = Sight { class: class.to_owned(), index, pixels, of: mask.ids.len() };
        match sights.iter_mut().find(|known| known.class == class) {
            Some(known) if known.pixels < pixels => *known = sight,
            Some(_) => {}
            None => sights.push(sight),
        }
    }
}

/// The classes to ask for: preferred classes that are seen well first, then the largest ones.
pub fn choose(mut sights: Vec<Sight>, classes: &[String]) -> Vec<Sight> {
    sights.retain(|sight| classes.contains(&sight.class));
    sights.sort_by_cached_key(|sight| {
        let rank = match sight.is_salient() {
            true => PREFERRED.iter().position(|class| *class == sight.class),
            false => None,
        };
        let rank = rank.unwrap_or(PREFERRED.len());
        (!sight.is_salient(), rank, Reverse(sight.pixels), sight.class.clone())
    });
    sights.truncate(QUESTIONS);
    sights
}

/// The questions for a data set without ground truth.
pub fn usual(kind: &DatasetSpec) -> Vec<String> {
    let words = match kind {
        DatasetSpec::SevenScenes(..) => IN_SEVEN_SCENES,
        _ => ANYWHERE,
    };
    words.map(str::to_owned).to_vec()
}

/// Up to eight items of a list, evenly spaced, with the first and the last.
pub fn spread<T: Copy>(all: &[T]) -> Vec<T> {
    if all.len() <= TRIED_FRAMES {
        return all.to_vec();
    }
    (0..TRIED_FRAMES).map(|step| all[step * (all.len() - 1) / (TRIED_FRAMES - 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(class: &str, pixels: usize) -> Sight {
        Sight { class: class.into(), index: 0, pixels, of: 1000 }
    }

    fn chosen(sights: &[(&str, usize)]) -> Vec<String> {
        let classes: Vec<String> =
            sights.iter().map(|(class, _)| (*class).into()).filter(|c| c != "wall").collect();
        let sights = sights.iter().map(|(class, pixels)| sight(class, *pixels)).collect();
        choose(sights, &classes).into_iter().map(|sight| sight.class).collect()
    }

    fn instance(id: u16, class: &str) -> Instance {
        Instance {
            id,
            name: format!("{class}_{id}"),
            class: class.into(),
            aabb_min: [0.0; 3],
            aabb_max: [1.0; 3],
        }
    }

    /// A picture of these ids with nothing around them.
    fn framed(rows: &[&[u16]]) -> Mask {
        let width = rows[0].len() + 2;
        let mut ids = vec![0; width];
        for row in rows {
            ids.extend([&[0], *row, &[0]].concat());
        }
        ids.extend(vec![0; width]);
        Mask { width: width as u32, height: rows.len() as u32 + 2, ids }
    }

    #[test]
    fn the_best_frame_of_a_class_counts_all_its_instances() {
        let instances = [instance(1, "chair"), instance(2, "chair"), instance(3, "lamp")];
        let mut sights = Vec::new();
        look(&mut sights, &instances, 10, &framed(&[&[1, 1, 0, 3]]));
        look(&mut sights, &instances, 20, &framed(&[&[1, 2, 1, 3]]));
        look(&mut sights, &instances, 30, &framed(&[&[2, 2, 2, 9]]));
        let of = |class: &str| sights.iter().find(|sight| sight.class == class).unwrap();
        assert_eq!((of("chair").index, of("chair").pixels, of("chair").of), (20, 3, 18));
        assert_eq!((of("lamp").index, of("lamp").pixels), (10, 1));
        assert_eq!(sights.len(), 2, "id 9 is nothing");
    }

    #[test]
    fn a_whole_object_is_preferred_to_a_larger_one_that_is_cut_off() {
        let instances = [instance(1, "plant")];
        let best = |cut: usize| {
            let mut sights = Vec::new();
            look(&mut sights, &instances, 10, &framed(&[&[1, 1]]));
            let mut ids = vec![1; cut];
            ids.resize(16, 0);
            look(&mut sights, &instances, 20, &Mask { width: 4, height: 4, ids });
            (sights[0].index, sights[0].pixels)
        };
        assert_eq!(best(7), (10, 2));
        // Negative control: much more of it is better again.
        assert_eq!(best(9), (20, 3));
    }

    #[test]
    fn preferred_classes_come_first_if_they_are_seen_well() {
        let all = [
            ("wall", 900),
            ("rug", 300),
            ("chair", 20),
            ("cabinet", 200),
            ("sofa", 9),
            ("laptop", 10),
            ("lamp", 50),
            ("ball", 200),
        ];
        assert_eq!(chosen(&all), ["chair", "laptop", "lamp", "rug", "ball"]);
        let mut turned = all;
        turned.reverse();
        assert_eq!(chosen(&turned), chosen(&all), "whatever the order");
        let better = all.map(|(class, n)| (class, if class == "sofa" { 10 } else { n }));
        assert_eq!(chosen(&better)[0], "sofa");
    }

    #[test]
    fn small_objects_follow_by_size() {
        assert_eq!(chosen(&[("sofa", 2), ("mug", 3), ("ball", 100)]), ["ball", "mug", "sofa"]);
        assert!(chosen(&[("wall", 500)]).is_empty());
    }

    #[test]
    fn frames_are_spread_from_first_to_last() {
        assert_eq!(spread(&[4, 5, 6]), [4, 5, 6]);
        let all: Vec<u64> = (0..71).collect();
        assert_eq!(spread(&all), [0, 10, 20, 30, 40, 50, 60, 70]);
        assert!(spread::<u64>(&[]).is_empty());
    }

    #[test]
    fn questions_depend_on_the_kind_of_data_set() {
        assert!(usual(&"7scenes:chess".parse().unwrap()).contains(&"screen".into()));
        assert!(!usual(&DatasetSpec::Tum("desk".into())).contains(&"screen".into()));
    }
}
