"""What a layer holds, told by its name: rules in the languages that plans are drawn in."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class LayerRole:
    """Hold as what a layer is taken, and the words of its name that say so."""

    role: str
    reason: str


# Words as they begin or end a token; a trailing * stands for any ending, a leading one for any beginning.
# What stands further up wins: a "wall hatch" is a hatch, a "wall text" a text.
_WORDS: Mapping[str, str] = {
    "hatch": "hatch* patt pattern* poche fill* hachure* remplissage retin* tratteg* campitur* schraff* "
    "sombread* rayado* rellen* trama tramas solid",
    "dimension": "dim dims dimension* dimn pub_dim bemass* mass massk* masskette* vermass* cote cotes "
    "cotation* quota quote quotatur* quotation* cota cotas acotad* acotacion*",
    "text": "text* txt anno annotation* note notes label* iden ident* tag tags title room* raum* "
    "beschrift* texte* titre* testo testi scritt* etichett* rotul* texto* nom noms nome nomi "
    "symb symbol* simbol* rights leggenda legend* legende area areas zone* raumnamen name "
    "names key keynote*",
    "stair": "stair* strs step steps treppe* *treppe *treppen escalier* marche* scala scale gradin* "
    "escaler* rampa ramp ramps rampe lift lifts elevator* aufzug* ascens* evtr handrail* "
    "railing* gelaender gelander ringhier* garde",
    "other": "demo demol* demolit* demolish* abbruch abriss demolir removed rimoss* ceiling* clng "
    "plafond* decke decken soffitt* techo* ovhd overhead* head above lights lamp* socket* "
    "elec* electr* elektr* finish* finiture finitura belag *belag revetement* rivestiment* "
    "insul* isolant* isolation daemm* dammung isolament* aislam* skirting plinth flor floor* "
    "flooring paviment* pavement boden fussboden sol sols suelo projection* proiezion* "
    "proyeccion* tile* roof* dach toit copertur* tetto cubiert* found* fundam* fondazion* "
    "cimient* fence* zaun cloture recinzion* cinta site terrain tree trees verde garden "
    "giardin* nplt defpoints viewport vport xref xrefs beam beams trav* trave travi poutre* "
    "unterzug*",
    "grid": "grid* axis axes axe assi asse achse* achs axen ejes eje dote griglia raster trame "
    "filifissi centerline* centreline* cntr center *achse *achsen",
    "frame": "ttlb titleblock* border* frame* sheet shet cartiglio cartouche squadratur* plankopf "
    "blattrahmen rahmen cadre cajetin marco formato margin* tk tkline logo archweb",
    "window": "window* glaz* glass* curtain* curt fenster* verglas* vitr* vetrat* vetro vetri finestr* "
    "fenetre* ventan* fassade facade menuiserie* infiss* serrament* carpinteri* cristal*",
    "door": "door* tuer tueren tur turen *tuer *tueren porte portes porta porti puerta* openings "
    "aperture",
    "furniture": "furn* equip* eqpm sanit* wc bath* kitchen* kuech* kuch* moebel* mobel* mobili* mobilier "
    "meuble* mueble* arred* bagno bagni cucin* cocina* appliance* fixt* fixture* plum* lvtry "
    "toilet* desk* chair* table* tavol* sedi* schrank* *schrank cabinet* casework* accessor* "
    "car cars auto people plant plants *moebel",
    "wall": "wall walls *wall *walls wand wande waende *wand *wande *waende mauer mauern mauerwerk "
    "*mauer *mauern *mauerwerk mur murs muri muro muros mura murat* muratur* murature *mur "
    "paret* tramezz* tamponam* setto setti divisor* partition* cloison* refend* voile voiles "
    "maconner* tabiq* pared paredes parede* cerramient* alvenar* masonry brick* blockwork "
    "drywall trockenbau* gkwand stud*",
    "column": "col cols colu colm column* pillar* pier piers stuetz* stutz* saeule* saule* pfeiler* "
    "poteau* pilastr* colonn* pilar* columna* clmn",
}  # fmt: skip

_SIGNS: Mapping[str, str] = {
    "hatch": "填充 ハッチ 剖面线 图案",
    "dimension": "标注 尺寸 寸法 標註",
    "text": "文字 说明 注释 名称 房间 編號 编号 部屋 室名 記号 符号",
    "other": "拆除 解体 天花 吊顶 天井 梁 地面 面层 床 女儿 护栏 设备 設備 电气 電気 保温",
    "grid": "轴 軸 芯 通り",
    "frame": "图框 図枠 圖框 图签",
    "stair": "楼梯 樓梯 階段 踏步 电梯 電梯 エレベータ 台阶 坡道",
    "window": "窗 幕墙 窓 サッシ 玻璃 ガラス",
    "door": "门 門 扉 建具 ドア",
    "furniture": "家具 洁具 卫生 厨 柜 什器 備品 衛生",
    "wall": "墙 牆 壁 砌体 隔断 間仕切 カベ",
    "column": "柱",
}  # fmt: skip

_SPLIT = re.compile(r"[^a-z]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")


def role_of(name: str) -> LayerRole | None:
    """Return what a layer's name says that it holds, or None where it says nothing.

    Names of external references (``SITE|A-WALL``, ``SITE$0$A-WALL``) are read by their last part. A name of
    several things is taken by the one that makes it less of a wall: a wall's hatch, a door in a wall.

    Parameters
    ----------
    name : str
        As the file spells it.

    Examples
    --------
    >>> role_of("A-WALL-EXTR").role, role_of("MURATURE tratteggi - wall hatch").role, role_of("柱").role
    ('wall', 'hatch', 'column')
    >>> role_of("0") is None
    True
    """
    own = re.split(r"\||\$\d+\$", name)[-1]
    for role, signs in _SIGNS.items():
        for sign in signs.split():
            if sign in own:
                return LayerRole(role, f"Its name says {role} ({sign}).")
    tokens = _tokens(own)
    for role in _WORDS:
        for token in tokens:
            if _PATTERNS[role].fullmatch(token):
                return LayerRole(role, f"Its name says {role} ({token}).")
    return None


def _tokens(name: str) -> list[str]:
    """Return the words of a name in small plain letters; accents and umlauts are taken off."""
    plain = unicodedata.normalize("NFKD", _CAMEL.sub(" ", name))
    plain = "".join(c for c in plain if not unicodedata.combining(c)).replace("ß", "ss").lower()
    return [t for t in _SPLIT.split(plain) if t]


def _pattern(words: str) -> re.Pattern[str]:
    return re.compile("|".join(re.escape(w).replace(r"\*", "[a-z]*") for w in words.split()))


_PATTERNS = {role: _pattern(words) for role, words in _WORDS.items()}
