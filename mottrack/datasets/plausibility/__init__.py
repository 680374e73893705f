"""Whether a scene is likely: values that are possible one by one, but hardly meant together."""
