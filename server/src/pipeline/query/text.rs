//! Words to embeddings: checks, the text tower, and a bounded cache of what it said.

use super::super::network::{NetworkError, RelevancySpec, TextTower};
use super::QueryError;
use super::relevancy::Comparison;
use super::request::{MAX_NEGATIVES, MAX_TEXT_BYTES, Query};
use std::collections::HashMap;
use std::sync::Arc;

/// The text tower with its cache.
pub(super) struct Words {
    tower: TextTower,
    relevancy: RelevancySpec,
    capacity: usize,
    /// Embedding and when it was last asked for.
    cache: HashMap<String, (u64, Arc<[f32]>)>,
    clock: u64,
}

impl Words {
    /// Keeps the embeddings of at most `capacity` texts, at least one.
    pub(super) fn new(tower: TextTower, relevancy: RelevancySpec, capacity: usize) -> Self {
        Self { tower, relevancy, capacity: capacity.max(1), cache: HashMap::new(), clock: 0 }
    }

    /// What the question's features are to be compared with.
    pub(super) fn comparison(&mut self, query: &Query) -> Result<Comparison, QueryError> {
        let text = checked("text", &query.text)?;
        let canonical = self.relevancy.negatives.clone();
        let negatives = match &query.negatives[..] {
            [] => &canonical,
            given => given,
        };
        if negatives.len() > MAX_NEGATIVES {
            return Err(QueryError::TooManyNegatives {
                limit: MAX_NEGATIVES,
                found: negatives.len(),
            });
        }
        let text = self.embedding(text)?;
        let negatives: Vec<Arc<[f32]>> = negatives
            .iter()
            .map(|negative| Ok(self.embedding(checked("negatives", negative)?)?))
            .collect::<Result<_, QueryError>>()?;
        let temperature = self.relevancy.temperature;
        Ok(Comparison::new(temperature, &text, negatives.iter().map(|negative| &negative[..])))
    }

    fn embedding(&mut self, text: &str) -> Result<Arc<[f32]>, NetworkError> {
        self.clock += 1;
        if let Some((asked, embedding)) = self.cache.get_mut(text) {
            *asked = self.clock;
            return Ok(embedding.clone());
        }
        let embedding: Arc<[f32]> = self.tower.embed(text)?.into();
        if self.cache.len() >= self.capacity {
            let oldest = self.cache.iter().min_by_key(|(_, (asked, _))| *asked);
            if let Some(oldest) = oldest.map(|(text, _)| text.clone()) {
                self.cache.remove(&oldest);
            }
        }
        self.cache.insert(text.to_owned(), (self.clock, embedding.clone()));
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
