//! Ids of answers.

/// A new id: 128 random bits in hexadecimal, so that ids cannot be guessed.
pub(crate) fn query_id() -> String {
    format!("{:032x}", rand::random::<u128>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_differ() {
        assert_ne!(query_id(), query_id());
        assert_eq!(query_id().len(), 32);
    }
}
