//! Lengths of files and functions, and types with `impl` blocks in several files.

use crate::imports::Resolver;
use crate::source::{Crate, Sources, attributes, is_test};
use std::collections::{BTreeMap, BTreeSet};
use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};

/// A function of product code.
#[derive(Debug)]
pub struct Function {
    /// Index into [`Crate::files`].
    pub file: usize,
    /// The function's name.
    pub name: String,
    /// Its first line in the file, from 1.
    pub line: usize,
    /// Lines from `fn` to the closing brace.
    pub lines: usize,
}

/// Every function, method and default method with a body that is no test.
pub fn functions(parsed: &Crate) -> Vec<Function> {
    let mut found = Vec::new();
    for module in &parsed.modules {
        let mut functions = Functions { file: module.file, found: Vec::new() };
        module.items.iter().for_each(|item| functions.visit_item(item));
        found.extend(functions.found);
    }
    found
}

struct Functions {
    file: usize,
    found: Vec<Function>,
}

impl Functions {
    fn add(&mut self, signature: &syn::Signature, block: &syn::Block) {
        let first = signature.span().start().line;
        let last = block.brace_token.span.close().end().line;
        let name = signature.ident.to_string();
        self.found.push(Function { file: self.file, name, line: first, lines: last + 1 - first });
    }
}

impl<'ast> Visit<'ast> for Functions {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_test(attributes(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.add(&item.sig, &item.block);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_test(&item.attrs) {
            self.add(&item.sig, &item.block);
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.add(&item.sig, block);
        }
        visit::visit_trait_item_fn(self, item);
    }
}

/// Lines of every file of a crate, by index into [`Crate::files`].
pub fn files(parsed: &Crate, sources: &Sources) -> Vec<usize> {
    parsed.files.iter().map(|file| sources[file].lines().count()).collect()
}

/// For each type with an `impl` block of its own (not of a trait), the files that hold such blocks:
/// keys are the file and name of the type, values are indices into [`Crate::files`].
pub fn impls(parsed: &Crate) -> BTreeMap<(Option<usize>, String), BTreeSet<usize>> {
    let resolver = Resolver::new(parsed);
    let mut found: BTreeMap<_, BTreeSet<usize>> = BTreeMap::new();
    for (at, module) in parsed.modules.iter().enumerate() {
        for item in &module.items {
            let syn::Item::Impl(block) = item else { continue };
            let syn::Type::Path(path) = &*block.self_ty else { continue };
            if block.trait_.is_none() {
                let segments = path.path.segments.iter().map(|segment| segment.ident.to_string());
                let key = resolver.definition(at, &segments.collect::<Vec<_>>());
                found.entry(key).or_default().insert(module.file);
            }
        }
    }
    found
}

/// The middle value; of an even number the higher of the two in the middle. 0 for none.
pub fn median(values: impl IntoIterator<Item = usize>) -> usize {
    let mut values: Vec<usize> = values.into_iter().collect();
    values.sort_unstable();
    values.get(values.len() / 2).copied().unwrap_or(0)
}
