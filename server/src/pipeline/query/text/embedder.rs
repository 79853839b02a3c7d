//! From texts to prompts: checks, the text tower, and a cache of its embeddings.

use super::cache::EmbeddingCache;
use super::subject::subject;
use crate::pipeline::network::{NetworkError, RelevancySpec, TextTower};
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::limits::{MAX_NEGATIVES, MAX_TEXT_BYTES};
use crate::pipeline::query::relevancy::{Prompts, Scale};
use std::sync::Arc;

/// The text tower with its cache.
pub(crate) struct TextEmbedder {
    tower: TextTower,
    scale: Scale,
    canonical_negatives: Vec<String>,
    cache: EmbeddingCache,
}

impl TextEmbedder {
    /// Caches the embeddings of at most `capacity` texts, at least 1.
    pub(crate) fn new(tower: TextTower, relevancy: RelevancySpec, capacity: usize) -> Self {
        let RelevancySpec { temperature, bias, negatives, .. } = relevancy;
        let scale = Scale { temperature, bias };
        let cache = EmbeddingCache::new(capacity);
        Self { tower, scale, canonical_negatives: negatives, cache }
    }

    /// Embeds texts and negatives; without negatives, the bundle's. `field` is the name of the
    /// texts in the request.
    pub(crate) fn prompts(
        &mut self,
        field: &'static str,
        texts: &[String],
        negatives: &[String],
    ) -> Result<Prompts, QueryError> {
        let texts = self.embed_all(field, texts)?;
        let canonical = self.canonical_negatives.clone();
        let negatives = if negatives.is_empty() { &canonical } else { negatives };
        if negatives.len() > MAX_NEGATIVES {
            let found = negatives.len();
            return Err(QueryError::TooManyNegatives { limit: MAX_NEGATIVES, found });
        }
        let negatives = self.embed_all("negatives", negatives)?;
        Ok(Prompts::new(self.scale, &texts, &negatives))
    }

    /// The embedding of a text, `[D]`, unit length.
    pub(crate) fn embed(
        &mut self,
        field: &'static str,
        text: &str,
    ) -> Result<Arc<[f32]>, QueryError> {
        Ok(self.embed_checked(checked(field, text)?)?)
    }

    fn embed_all(
        &mut self,
        field: &'static str,
        texts: &[String],
    ) -> Result<Vec<Arc<[f32]>>, QueryError> {
        texts.iter().map(|text| self.embed(field, text)).collect()
    }

    fn embed_checked(&mut self, text: &str) -> Result<Arc<[f32]>, NetworkError> {
        if let Some(embedding) = self.cache.get(text) {
            return Ok(embedding);
        }
        let embedding: Arc<[f32]> = self.tower.embed(text)?.into();
        self.cache.put(text, embedding.clone());
        Ok(embedding)
    }
}

/// The name of the thing that a text asks for.
fn checked<'a>(field: &'static str, text: &'a str) -> Result<&'a str, QueryError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(QueryError::TextTooLong { field, limit: MAX_TEXT_BYTES, found: text.len() });
    }
    match subject(text) {
        "" => Err(QueryError::EmptyText { field }),
        text => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_has_a_length_and_asks_for_something() {
        assert_eq!(checked("text", "  coffee cup\n").unwrap(), "coffee cup");
        assert_eq!(checked("text", "Where is the coffee cup?").unwrap(), "coffee cup");
        assert!(matches!(checked("text", "\t "), Err(QueryError::EmptyText { field: "text" })));
        assert!(matches!(checked("text", " ? "), Err(QueryError::EmptyText { field: "text" })));
        let long = "a".repeat(MAX_TEXT_BYTES + 1);
        assert!(matches!(checked("text", &long), Err(QueryError::TextTooLong { .. })));
        assert!(checked("text", &long[1..]).is_ok());
    }
}
