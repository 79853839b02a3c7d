//! Words to embeddings: checks, the text tower, and a bounded cache of what it said.

use super::super::network::{NetworkError, RelevancySpec, TextTower};
use super::QueryError;
use super::relevancy::{Comparison, Scale};
use super::request::{Contest, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, Query};
use super::rivals::Rivals;
use std::collections::HashMap;
use std::sync::Arc;

/// The text tower with its cache.
pub(super) struct Words {
    tower: TextTower,
    relevancy: RelevancySpec,
    cache: Cache,
}

impl Words {
    /// Keeps the embeddings of at most `capacity` texts, at least 1.
    pub(super) fn new(tower: TextTower, relevancy: RelevancySpec, capacity: usize) -> Self {
        Self { tower, relevancy, cache: Cache::new(capacity) }
    }

    /// What the question's features are to be compared with.
    pub(super) fn comparison(&mut self, query: &Query) -> Result<Comparison, QueryError> {
        let text = self.embedding(checked("text", &query.text)?)?;
        let negatives = self.negatives(&query.negatives)?;
        Ok(Comparison::new(self.scale(), &text, negatives.iter().map(|negative| &negative[..])))
    }

    /// Several texts that compete for every feature.
    pub(super) fn rivals(&mut self, contest: &Contest) -> Result<Rivals, QueryError> {
        let found = contest.texts.len();
        if !(2..=MAX_TEXTS).contains(&found) {
            return Err(QueryError::WrongTextCount { limit: MAX_TEXTS, found });
        }
        let texts: Vec<Arc<[f32]>> = contest
            .texts
            .iter()
            .map(|text| Ok(self.embedding(checked("texts", text)?)?))
            .collect::<Result<_, QueryError>>()?;
        let negatives = self.negatives(&contest.negatives)?;
        Ok(Rivals::new(self.scale(), &texts, &negatives))
    }

    /// The given negatives, or the bundle's if there are none.
    fn negatives(&mut self, given: &[String]) -> Result<Vec<Arc<[f32]>>, QueryError> {
        let canonical = self.relevancy.negatives.clone();
        let negatives = if given.is_empty() { &canonical[..] } else { given };
        if negatives.len() > MAX_NEGATIVES {
            let found = negatives.len();
            return Err(QueryError::TooManyNegatives { limit: MAX_NEGATIVES, found });
        }
        negatives
            .iter()
            .map(|negative| Ok(self.embedding(checked("negatives", negative)?)?))
            .collect()
    }

    /// From cosines to relevancy, as the bundle has it.
    fn scale(&self) -> Scale {
        let RelevancySpec { temperature, bias, .. } = self.relevancy;
        Scale { temperature, bias }
    }

    /// A text's embedding `[D]`, unit length.
    pub(super) fn embed(&mut self, text: &str) -> Result<Arc<[f32]>, QueryError> {
        Ok(self.embedding(checked("text", text)?)?)
    }

    fn embedding(&mut self, text: &str) -> Result<Arc<[f32]>, NetworkError> {
        if let Some(embedding) = self.cache.get(text) {
            return Ok(embedding);
        }
        let embedding: Arc<[f32]> = self.tower.embed(text)?.into();
        self.cache.put(text, embedding.clone());
        Ok(embedding)
    }
}

/// The text without white space around it.
fn checked<'a>(field: &'static str, text: &'a str) -> Result<&'a str, QueryError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(QueryError::TextTooLong { field, limit: MAX_TEXT_BYTES, found: text.len() });
    }
    match text.trim() {
        "" => Err(QueryError::EmptyText { field }),
        text => Ok(text),
    }
}

/// Embeddings of the texts that were asked for last.
struct Cache {
    capacity: usize,
    /// When a text was last asked for, and its embedding.
    entries: HashMap<String, (u64, Arc<[f32]>)>,
    clock: u64,
}

impl Cache {
    fn new(capacity: usize) -> Self {
        Self { capacity, entries: HashMap::new(), clock: 0 }
    }

    fn get(&mut self, text: &str) -> Option<Arc<[f32]>> {
        let (asked, embedding) = self.entries.get_mut(text)?;
        self.clock += 1;
        *asked = self.clock;
        Some(embedding.clone())
    }

    /// A full cache forgets what was not asked for longest.
    fn put(&mut self, text: &str, embedding: Arc<[f32]>) {
        if self.entries.len() >= self.capacity {
            let oldest = self.entries.iter().min_by_key(|(_, (asked, _))| *asked);
            if let Some(oldest) = oldest.map(|(text, _)| text.clone()) {
                self.entries.remove(&oldest);
            }
        }
        self.clock += 1;
        self.entries.insert(text.to_owned(), (self.clock, embedding));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_cache_forgets_what_was_not_asked_for_longest() {
        let mut cache = Cache::new(2);
        cache.put("cup", [1.0].into());
        cache.put("sofa", [2.0].into());
        assert_eq!(cache.get("cup").as_deref(), Some(&[1.0][..]));
        cache.put("lamp", [3.0].into());
        assert_eq!(cache.get("sofa"), None);
        assert_eq!(cache.get("cup").as_deref(), Some(&[1.0][..]));
        assert_eq!(cache.get("lamp").as_deref(), Some(&[3.0][..]));
        assert_eq!(cache.entries.len(), 2);
    }

    #[test]
    fn white_space_around_a_text_does_not_count() {
        assert_eq!(checked("text", "  coffee cup\n").unwrap(), "coffee cup");
        assert!(matches!(checked("text", "\t "), Err(QueryError::EmptyText { field: "text" })));
        let long = "a".repeat(MAX_TEXT_BYTES + 1);
        assert!(matches!(checked("text", &long), Err(QueryError::TextTooLong { .. })));
        assert!(checked("text", &long[1..]).is_ok());
    }
}
