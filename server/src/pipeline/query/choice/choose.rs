//! The choice among the objects of a kind.
//!
//! First what holds for an object alone (colors), or compared with all others of its kind ("big"); then the
//! relation; then what compares those that are left: "largest", "nearest to".

use super::look::{Look, having};
use super::messages;
use super::nearness::gap;
use super::relation::{holds, is_between};
use super::shape::Shape;
use super::sight::Sight;
use crate::pipeline::query::question::{
    Attribute, AttributeKind, Relation, RelationKind, Size, Wanted,
};
use crate::pipeline::query::space::FoundObject;
use lexsplat_gpu::{Camera, HostGaussians};
use nalgebra::UnitQuaternion;

/// Things of a kind are as large as each other if the largest one is less than so much larger.
const ALIKE: f32 = 1.15;
/// Two objects are the same if they share this part of the larger one's Gaussians.
const SAME: f32 = 0.5;

/// What a text wants, with what was found of its kind, and the same for the things it is related to.
pub(crate) struct Candidates<'a> {
    pub wanted: &'a Wanted,
    pub objects: Vec<FoundObject>,
    /// Whether the map has such a thing: objects alone may be doubtful.
    pub is_present: bool,
    pub others: Vec<Candidates<'a>>,
}

/// What a choice depends on beside the objects.
pub(crate) struct Surroundings<'a> {
    pub gaussians: &'a HostGaussians,
    /// The rotation after which up is z; `None` if up is not known.
    pub level_from_world: Option<UnitQuaternion<f32>>,
    /// Where one looks from.
    pub camera: Option<&'a Camera>,
}

/// The objects that are meant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Choice {
    /// Indices of the objects.
    pub kept: Vec<usize>,
    /// Why there is none; `None` if there is one.
    pub reason: Option<String>,
}

impl Choice {
    fn none(reason: String) -> Self {
        Self { kept: Vec::new(), reason: Some(reason) }
    }
}

/// Chooses the objects that have all attributes and the relation.
pub(crate) fn choose(candidates: &Candidates<'_>, around: &Surroundings<'_>) -> Choice {
    let Candidates { wanted, objects, .. } = candidates;
    if objects.is_empty() {
        return Choice::none(messages::nothing(wanted));
    }
    let shapes = Shapes { all: objects.iter().map(|object| shape(object, around)).collect() };
    let mut kept: Vec<usize> = (0..objects.len()).collect();
    let looks = looks(candidates, around);
    for attribute in wanted.attributes.iter().filter(|one| superlative(one).is_none()) {
        let has = shapes.having(attribute.kind, &looks);
        kept.retain(|&at| has[at] != attribute.is_negated);
        if kept.is_empty() {
            return Choice::none(messages::without_attribute(wanted, *attribute, &looks));
        }
    }
    if let Some(relation) = &wanted.relation {
        match related(candidates, relation, &shapes, &kept, around) {
            Ok(related) => kept = related,
            Err(reason) => return Choice::none(reason),
        }
    }
    let most = wanted.attributes.iter().filter_map(superlative);
    for (size, is_negated) in most {
        let best = shapes.extreme(size, &kept);
        kept.retain(|&at| (Some(at) == best) != is_negated);
    }
    let reason = kept.is_empty().then(|| messages::no_other(wanted));
    Choice { kept, reason }
}

fn superlative(attribute: &Attribute) -> Option<(Size, bool)> {
    match attribute.kind {
        AttributeKind::Size(size) if size.is_most => Some((size, attribute.is_negated)),
        _ => None,
    }
}

/// The looks of all objects; none if nobody asks for them.
fn looks(candidates: &Candidates<'_>, around: &Surroundings<'_>) -> Vec<Look> {
    let needs = |attribute: &Attribute| !matches!(attribute.kind, AttributeKind::Size(_));
    if !candidates.wanted.attributes.iter().any(needs) {
        return Vec::new();
    }
    let look = |found: &FoundObject| Look::new(around.gaussians, found.rows());
    candidates.objects.iter().map(look).collect()
}

fn shape(found: &FoundObject, around: &Surroundings<'_>) -> Shape {
    let level = around.level_from_world.unwrap_or_default();
    Shape::new(&found.surface(around.gaussians), &level)
}

/// Those of the kept objects that have the relation, or the reason why it cannot be decided or none has it.
fn related(
    candidates: &Candidates<'_>,
    relation: &Relation,
    shapes: &Shapes,
    kept: &[usize],
    around: &Surroundings<'_>,
) -> Result<Vec<usize>, String> {
    if relation.kind.needs_view() && around.camera.is_none() {
        return Err(messages::no_view(relation));
    }
    if around.level_from_world.is_none() {
        return Err(messages::no_up(relation));
    }
    let mut others = Vec::new();
    for other in &candidates.others {
        let (chosen, is_decided) = match other.is_present {
            true => (choose(other, around), can_decide(other.wanted, around)),
            false => (Choice::none(messages::nothing(other.wanted)), true),
        };
        match chosen.reason {
            None => {}
            // Nothing is next to what is not there.
            Some(_) if relation.is_negated && is_decided => return Ok(kept.to_vec()),
            Some(reason) => return Err(reason),
        }
        others.push(chosen.kept.iter().map(|&at| &other.objects[at]).collect::<Vec<_>>());
    }
    let others = others.iter().map(|kind| Others::new(kind, &candidates.objects, around)).collect();
    let related = Related { relation, shapes, others, around };
    let chosen = related.chosen(kept);
    let none = || messages::without_relation(candidates.wanted, kept.len());
    if chosen.is_empty() { Err(none()) } else { Ok(chosen) }
}

/// Whether all relations that a thing has can be decided.
fn can_decide(wanted: &Wanted, around: &Surroundings<'_>) -> bool {
    wanted.relation.as_ref().is_none_or(|relation| {
        let sees = !relation.kind.needs_view() || around.camera.is_some();
        let stands = around.level_from_world.is_some();
        sees && stands && relation.others.iter().all(|other| can_decide(other, around))
    })
}

/// The shapes of all objects.
struct Shapes {
    all: Vec<Shape>,
}

impl Shapes {
    /// For each object whether it has an attribute.
    fn having(&self, kind: AttributeKind, looks: &[Look]) -> Vec<bool> {
        match kind {
            AttributeKind::Color(color) => having(looks, color),
            AttributeKind::Dark => looks.iter().map(Look::is_dark).collect(),
            AttributeKind::Light => looks.iter().map(Look::is_light).collect(),
            AttributeKind::Size(size) => self.sized(size),
        }
    }

    fn measure(&self, size: Size, at: usize) -> f32 {
        let shape = &self.all[at];
        if size.is_height { shape.height() } else { shape.diagonal() }
    }

    /// Larger, or smaller, than the middle between the smallest and the largest. Where all are alike, all
    /// are.
    fn sized(&self, size: Size) -> Vec<bool> {
        let measures: Vec<f32> = (0..self.all.len()).map(|at| self.measure(size, at)).collect();
        let least = measures.iter().copied().fold(f32::INFINITY, f32::min).max(1e-3);
        let most = measures.iter().copied().fold(1e-3, f32::max);
        let middle = (least * most).sqrt();
        let is_sized = |measure: &f32| most < ALIKE * least || (*measure >= middle) == size.is_more;
        measures.iter().map(is_sized).collect()
    }

    /// The one of the kept objects that has the most.
    fn extreme(&self, size: Size, kept: &[usize]) -> Option<usize> {
        let sign = if size.is_more { 1.0 } else { -1.0 };
        let key = |at: &usize| sign * self.measure(size, *at);
        kept.iter().copied().max_by(|a, b| key(a).total_cmp(&key(b)))
    }
}

/// The objects of another kind, as each candidate sees them: their shapes without the Gaussians that they share
/// with it. A cushion looks a little like a part of its sofa.
struct Others {
    of_candidate: Vec<Vec<Shape>>,
}

impl Others {
    fn new(kind: &[&FoundObject], candidates: &[FoundObject], around: &Surroundings<'_>) -> Self {
        let whole: Vec<Shape> = kind.iter().map(|other| shape(other, around)).collect();
        let beside = |own: &FoundObject| {
            let seen = kind.iter().zip(&whole).filter_map(|(other, whole)| {
                let shared = own.shared(other);
                if shared > SAME {
                    return None;
                }
                Some(if shared == 0.0 { whole.clone() } else { shape(&other.without(own), around) })
            });
            seen.collect()
        };
        Self { of_candidate: candidates.iter().map(beside).collect() }
    }
}

/// A relation with everything that decides it.
struct Related<'a> {
    relation: &'a Relation,
    shapes: &'a Shapes,
    /// For each of the relation's other kinds.
    others: Vec<Others>,
    around: &'a Surroundings<'a>,
}

impl Related<'_> {
    /// Those of the kept objects that have the relation, or do not have it if it is negated.
    fn chosen(&self, kept: &[usize]) -> Vec<usize> {
        let Relation { kind, is_negated, .. } = self.relation;
        if let RelationKind::Nearest | RelationKind::Farthest = kind {
            let best = self.extreme(kept);
            return kept.iter().copied().filter(|at| (Some(*at) == best) != *is_negated).collect();
        }
        kept.iter().copied().filter(|at| self.holds(*at) != *is_negated).collect()
    }

    fn holds(&self, at: usize) -> bool {
        let (kind, own) = (self.relation.kind, &self.shapes.all[at]);
        let others = |of: usize| &self.others[of].of_candidate[at];
        match kind {
            RelationKind::Between if self.others.len() == 1 => {
                let others = others(0);
                let pairs = (0..others.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
                pairs.into_iter().any(|(i, j)| is_between(own, &others[i], &others[j]))
            }
            RelationKind::Between => others(0)
                .iter()
                .any(|first| others(1).iter().any(|second| is_between(own, first, second))),
            kind if kind.needs_view() => others(0).iter().any(|other| self.looks_so(own, other)),
            kind => others(0).iter().any(|other| holds(kind, own, other)),
        }
    }

    fn looks_so(&self, own: &Shape, other: &Shape) -> bool {
        let Some((camera, level)) = self.around.camera.zip(self.around.level_from_world) else {
            return false;
        };
        let sight = |shape: &Shape| Sight::new(shape, camera, &level.inverse());
        let both = sight(own).zip(sight(other));
        both.is_some_and(|(own, other)| own.holds(self.relation.kind, &other))
    }

    /// The nearest of the kept objects, or the farthest.
    fn extreme(&self, kept: &[usize]) -> Option<usize> {
        let sign = if self.relation.kind == RelationKind::Nearest { 1.0 } else { -1.0 };
        let distance = |at: usize| {
            let others = self.others[0].of_candidate[at].iter();
            others.map(|other| gap(&self.shapes.all[at], other)).fold(f32::INFINITY, f32::min)
        };
        let priced = kept.iter().map(|&at| (sign * distance(at), at));
        priced.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
    }
}
