//! `#[derive(ObservationSpace)]`.

use crate::field::{Field, check_names, fields_of};
use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, Error, Expr, Result};

/// Writes the implementation.
pub fn expand(input: &DeriveInput) -> Result<TokenStream> {
    let fields = fields_of(input, "an observation")?;
    check_names(&fields)?;
    let entries = fields.iter().map(entry).collect::<Result<Vec<_>>>()?;
    let idents: Vec<_> = fields.iter().map(|field| &field.ident).collect();
    let types: Vec<_> = fields.iter().map(|field| &field.ty).collect();
    let name = &input.ident;
    let (generics, arguments, bounds) = input.generics.split_for_impl();
    Ok(quote! {
        impl #generics ::bevy_ludus::space::ObservationSpace for #name #arguments #bounds {
            fn entries() -> ::std::vec::Vec<::bevy_ludus::wire::ObservationEntry> {
                ::std::vec![#(#entries),*]
            }

            fn zero() -> Self {
                Self { #(#idents: <#types as ::bevy_ludus::space::ObservationValue>::ZERO),* }
            }

            #[inline]
            fn write(&self, row: &mut ::bevy_ludus::space::RowWriter<'_>) {
                #(row.put(&self.#idents);)*
            }
        }
    })
}

fn entry(field: &Field) -> Result<TokenStream> {
    if let Some(n) = &field.options.n {
        return Err(Error::new(
            n.span(),
            "n is for actions; an observation has low and high",
        ));
    }
    let (ty, name) = (&field.ty, &field.name);
    let low = bound(field.options.low.as_ref());
    let high = bound(field.options.high.as_ref());
    Ok(quote! { ::bevy_ludus::space::entry::<#ty>(#name, #low, #high) })
}

fn bound(value: Option<&Expr>) -> TokenStream {
    match value {
        Some(value) => quote! { ::core::option::Option::Some((#value).into()) },
        None => quote! { ::core::option::Option::None },
    }
}
