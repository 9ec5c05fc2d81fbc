//! The derive macros of `bevy_ludus`: a Rust type becomes a space and a row.

mod action_space;
mod field;
mod observation_space;
#[cfg(test)]
mod tests;

use proc_macro::TokenStream;
use syn::{DeriveInput, parse_macro_input};

/// Makes a struct an observation: field names become entry names.
///
/// Attributes of a field: `#[ludus(low = 0.0, high = 1.0)]` (a number, or a list with one per
/// element) and `#[ludus(name = "other")]`.
#[proc_macro_derive(ObservationSpace, attributes(ludus))]
pub fn derive_observation_space(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    observation_space::expand(&input)
        .unwrap_or_else(syn::Error::into_compile_error)
        .into()
}

/// Makes a struct an action: field names become component names. An enum without fields becomes one
/// choice among its variants.
///
/// Attributes of a field: `#[ludus(n = 4)]` for an integer, `#[ludus(low = -1.0, high = 1.0)]` for
/// numbers (these are the bounds without it) and `#[ludus(name = "other")]`, also for an enum.
#[proc_macro_derive(ActionSpace, attributes(ludus))]
pub fn derive_action_space(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    action_space::expand(&input)
        .unwrap_or_else(syn::Error::into_compile_error)
        .into()
}
