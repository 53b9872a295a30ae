"""How much results change when the same shape comes turned, remeshed, coarse or noisy."""
