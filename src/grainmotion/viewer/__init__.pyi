from .layers import layers as layers
from .layers import residual_layers as residual_layers
from .window import open as open
from .window import open_residuals as open_residuals
