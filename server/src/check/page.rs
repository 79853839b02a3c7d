//! Lists in pages.

use super::refusal::Refusal;

/// One page of a list that is sorted by a key `K`.
#[derive(Debug)]
pub(crate) struct Page<K> {
    /// Number of items; all if `None`.
    limit: Option<usize>,
    /// Only what comes after this key.
    after: Option<K>,
}

/// The items of a page, and the key that the next page comes after; `None` if this is the last one.
pub(crate) type Paged<T, K> = (Vec<T>, Option<K>);

impl<K: Ord> Page<K> {
    /// Checks the options `limit` and `after`.
    ///
    /// # Errors
    /// [`Refusal`] of a limit of 0.
    pub(crate) fn new(limit: Option<u32>, after: Option<K>) -> Result<Self, Refusal> {
        if limit == Some(0) {
            return Err(Refusal::new("limit", "expected at least 1, found 0"));
        }
        Ok(Self { limit: limit.map(|limit| limit as usize), after })
    }

    /// The page of a sorted list.
    pub(crate) fn of<T>(
        &self,
        sorted: impl IntoIterator<Item = T>,
        key: impl Fn(&T) -> K,
    ) -> Paged<T, K> {
        let is_before = |item: &T| self.after.as_ref().is_some_and(|after| key(item) <= *after);
        let mut rest = sorted.into_iter().skip_while(is_before).peekable();
        let items: Vec<T> = rest.by_ref().take(self.limit.unwrap_or(usize::MAX)).collect();
        let next = rest.peek().and(items.last().map(&key));
        (items, next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(limit: Option<u32>, after: Option<u32>) -> Paged<u32, u32> {
        Page::new(limit, after).unwrap().of([2, 3, 5, 7], |item| *item)
    }

    #[test]
    fn pages_have_every_item_once() {
        assert_eq!(page(None, None), (vec![2, 3, 5, 7], None));
        assert_eq!(page(Some(3), None), (vec![2, 3, 5], Some(5)));
        assert_eq!(page(Some(3), Some(5)), (vec![7], None));
        assert_eq!(page(Some(4), None), (vec![2, 3, 5, 7], None), "nothing comes after it");
        // What was the last item may be gone.
        assert_eq!(page(Some(1), Some(4)), (vec![5], Some(5)));
        assert_eq!(page(None, Some(7)), (vec![], None));
        assert_eq!(Page::<u32>::new(Some(0), None).unwrap_err().field, "limit");
    }
}
