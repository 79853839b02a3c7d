//! From texts to prompts: checks, the text tower, and a cache of its embeddings.

use super::cache::EmbeddingCache;
use crate::pipeline::network::{NetworkError, RelevancySpec, TextTower};
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::limits::{MAX_NEGATIVES, MAX_TEXT_BYTES};
use crate::pipeline::query::question::{self, Unclear, Wanted};
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

    /// Embeds texts with all that they say of a thing, and negatives; without negatives, the bundle's.
    /// `field` is the name of the texts in the request.
    pub(crate) fn prompts(
        &mut self,
        field: &'static str,
        texts: &[String],
        negatives: &[String],
    ) -> Result<Prompts, QueryError> {
        let texts: Result<Vec<_>, _> = texts.iter().map(|text| self.embed(field, text)).collect();
        self.with_negatives(&texts?, negatives)
    }

    /// Embeds the names of what is wanted, without attributes and relation, and negatives.
    pub(crate) fn prompts_of(
        &mut self,
        wanted: &Wanted,
        negatives: &[String],
    ) -> Result<Prompts, QueryError> {
        let names: Result<Vec<_>, _> =
            wanted.names.iter().map(|name| self.embed_name(name)).collect();
        self.with_negatives(&names?, negatives)
    }

    /// The embedding of a text with all that it says of a thing, `[D]`, unit length.
    pub(crate) fn embed(
        &mut self,
        field: &'static str,
        text: &str,
    ) -> Result<Arc<[f32]>, QueryError> {
        check_length(field, text)?;
        let name = question::name(text).ok_or(QueryError::EmptyText { field })?;
        Ok(self.embed_name(&name)?)
    }

    fn with_negatives(
        &mut self,
        texts: &[Arc<[f32]>],
        negatives: &[String],
    ) -> Result<Prompts, QueryError> {
        let canonical = self.canonical_negatives.clone();
        let negatives = if negatives.is_empty() { &canonical } else { negatives };
        if negatives.len() > MAX_NEGATIVES {
            let found = negatives.len();
            return Err(QueryError::TooManyNegatives { limit: MAX_NEGATIVES, found });
        }
        let embed = |negative: &String| self.embed("negatives", negative);
        let negatives: Result<Vec<_>, _> = negatives.iter().map(embed).collect();
        Ok(Prompts::new(self.scale, texts, &negatives?))
    }

    fn embed_name(&mut self, name: &str) -> Result<Arc<[f32]>, NetworkError> {
        if let Some(embedding) = self.cache.get(name) {
            return Ok(embedding);
        }
        let embedding: Arc<[f32]> = self.tower.embed(name)?.into();
        self.cache.put(name, embedding.clone());
        Ok(embedding)
    }
}

/// What a text asks for.
pub(crate) fn wanted(field: &'static str, text: &str) -> Result<Wanted, QueryError> {
    check_length(field, text)?;
    question::wanted(text).map_err(|unclear| match unclear {
        Unclear::Empty => QueryError::EmptyText { field },
        Unclear::Refused(reason) => QueryError::NotUnderstood { field, reason },
    })
}

fn check_length(field: &'static str, text: &str) -> Result<(), QueryError> {
    match text.len() {
        0..=MAX_TEXT_BYTES => Ok(()),
        found => Err(QueryError::TextTooLong { field, limit: MAX_TEXT_BYTES, found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_has_a_length_and_asks_for_something() {
        assert_eq!(wanted("text", "  coffee cup\n").unwrap(), Wanted::plain("coffee cup"));
        assert!(matches!(wanted("text", "\t "), Err(QueryError::EmptyText { field: "text" })));
        let not = wanted("text", "not a cup");
        assert!(matches!(not, Err(QueryError::NotUnderstood { field: "text", .. })), "{not:?}");
        let long = "a".repeat(MAX_TEXT_BYTES + 1);
        assert!(matches!(wanted("text", &long), Err(QueryError::TextTooLong { .. })));
        assert!(wanted("text", &long[1..]).is_ok());
    }
}
