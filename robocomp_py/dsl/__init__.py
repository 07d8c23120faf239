"""The languages: text to checked, linked models. Nothing downstream of `link` sees syntax."""
