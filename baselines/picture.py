"""Pictures of curves, as SVG."""


def page(size, title, parts):
    """A page of so many pixels with these elements on white."""
    width, height = size
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    style = ' font-family="sans-serif" font-size="12" fill="#222">'
    back = '<rect width="100%" height="100%" fill="#fff"/>'
    return "\n".join([head + style, f"<title>{title}</title>", back, *parts, "</svg>"]) + "\n"


def named(x, y, name, colour, dashes=""):
    """A piece of a curve and its name, for a legend."""
    return [
        f'<path d="M{x},{y - 4} h28" stroke="{colour}" stroke-width="3"{dashes}/>',
        f'<text x="{x + 36}" y="{y}">{name}</text>',
    ]


def levels(x, y_of, width, values, unit=""):
    """Lines of equal height, with their values at the left."""
    parts = []
    for value in values:
        y = y_of(value)
        parts.append(f'<path d="M{x},{y:g} h{width}" stroke="#e2e2e2"/>')
        parts.append(f'<text x="{x - 6}" y="{y + 4:g}" text-anchor="end">{value}{unit}</text>')
    return parts
