//! A bounded cache of text embeddings.

use std::collections::HashMap;
use std::sync::Arc;

/// Embeddings of the most recently used texts.
pub(super) struct EmbeddingCache {
    capacity: usize,
    /// For each text the time of its last use and its embedding.
    entries: HashMap<String, (u64, Arc<[f32]>)>,
    /// Counts uses.
    clock: u64,
}

impl EmbeddingCache {
    /// `capacity` is at least 1.
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, entries: HashMap::new(), clock: 0 }
    }

    pub(super) fn get(&mut self, text: &str) -> Option<Arc<[f32]>> {
        let (last_use, embedding) = self.entries.get_mut(text)?;
        self.clock += 1;
        *last_use = self.clock;
        Some(embedding.clone())
    }

    /// Adds an embedding. A full cache drops the least recently used one.
    pub(super) fn put(&mut self, text: &str, embedding: Arc<[f32]>) {
        if self.entries.len() >= self.capacity {
            let oldest = self.entries.iter().min_by_key(|(_, (last_use, _))| *last_use);
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
    fn a_full_cache_drops_the_least_recently_used_text() {
        let mut cache = EmbeddingCache::new(2);
        cache.put("cup", [1.0].into());
        cache.put("sofa", [2.0].into());
        assert_eq!(cache.get("cup").as_deref(), Some(&[1.0][..]));
        cache.put("lamp", [3.0].into());
        assert_eq!(cache.get("sofa"), None);
        assert_eq!(cache.get("cup").as_deref(), Some(&[1.0][..]));
        assert_eq!(cache.get("lamp").as_deref(), Some(&[3.0][..]));
        assert_eq!(cache.entries.len(), 2);
    }
}
