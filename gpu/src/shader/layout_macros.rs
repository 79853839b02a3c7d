//! The macros of `layout.rs`: constants and structs for Rust, and what WGSL is made from.

macro_rules! constants {
    ($($(#[$doc:meta])* $name:ident: $kind:ident = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: $kind = $value;)*

        fn write_constants(text: &mut String) {
            $(let _ = writeln!(
                text,
                "const {}: {} = {:?};",
                stringify!($name),
                stringify!($kind),
                $name,
            );)*
        }
    };
}

macro_rules! structs {
    ($($(#[$doc:meta])* $name:ident {
        $($(#[$field_doc:meta])* $field:ident: $kind:ty => $wgsl:literal,)*
    })*) => {
        $($(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$field_doc])* pub $field: $kind,)* })*

        /// Every struct above, with its layout in WGSL.
        pub const STRUCTS: &[Struct] = &[$(Struct {
            name: stringify!($name),
            size: size_of::<$name>(),
            fields: &[$(Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                wgsl: $wgsl,
            },)*],
        },)*];
    };
}

pub(super) use {constants, structs};
